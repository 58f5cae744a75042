"""Contact as a permission: exactly the pair, the place and the depth that a request names, and never longer than it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lrm_math.arm.collision_shapes import WORLD, Capsule, HeightField
from lrm_math.arrays import Array
from lrm_math.collision.contact import Contact, ContactPermit
from lrm_math.collision.scene import Scene
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.ik.nominal import NominalSolver
from lrm_math.model.model import Model, model_of
from lrmd.config import Config, load_config
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.messages.surroundings import ContactEntry
from lrmd.safety.collision_guard import CollisionGuard
from lrmd.safety.contact_force import permits
from tests.soak.guard_sequences import FASTER
from tests.support.daemon.armed_daemon import ArmedDaemon
from tests.support.daemon.guarded_sequence import MARGIN, GuardedSequence, cluttered_arm
from tests.support.daemon.in_memory_daemon import CONFIG
from tests.support.daemon.independent_distances import bodies_apart, link_frames
from tests.support.sweep import examples, soak

pytestmark = pytest.mark.long

ABOVE = np.array([0.57, 1.15, -0.75, -0.14, -0.76, -1.12])
EVERYWHERE = {"low_m": [-1.0, -1.0, -1.0], "high_m": [1.0, 1.0, 1.0]}
GROUND = ContactEntry(first="fingers", second="ground", **EVERYWHERE)


@pytest.fixture(scope="module")
def config() -> Config:
    return replace(load_config(CONFIG), stagger=20_000_000)


@pytest.fixture(scope="module")
def scene(config: Config) -> Scene:
    return Scene.of(config.arm)


def number(scene: Scene, first: str, second: str) -> int:
    return scene.names.tolist().index([first, second])


def bent(scene: Scene, config: Config) -> Array:
    """A pose in which the fingers, and nothing else, are nearer to the ground than the margin (rad)."""
    pair, solver = number(scene, "fingers", "ground"), NominalSolver.of(config.arm)
    for x in np.arange(0.12, 0.3, 0.02):
        found = solver.solve_batch(np.full((1, 3), (x, 0.05, 0.008)), np.diag([1.0, -1.0, -1.0])[None])
        for q in found.q[found.valid]:
            apart = scene.separations(scene.frames(q[None]))[0]
            if 0.0 < apart[pair] < 0.02 and np.delete(apart, pair).min() > scene.margin + 0.003:
                return np.asarray(q)
    raise AssertionError("no such pose")


def soft(config: Config) -> Model:
    """Springs of 0.05 rad/N m in every joint."""
    springs = {f"compliance.joint{i}.k_rad_per_Nm": 0.05 for i in range(1, 7)}
    return model_of(config.arm, effects_at(config.arm, "compliance"), springs)


def rigid(config: Config, start: Array) -> ArmedDaemon:
    """Armed at a pose, with the guard of the rigid arm."""
    return ArmedDaemon.among(config, CollisionGuard(Scene.of(config.arm), None), start)


def test_a_permit_raises_the_distance_of_its_pair_in_its_region_and_of_no_other(scene: Scene, config: Config) -> None:
    q = bent(scene, config) + np.random.default_rng(1).normal(0.0, 0.2, (500, 6))
    placed = scene.frames(q)
    tips, before = placed[:, -1, :3, 3], scene.separations(placed)
    permit = ContactPermit("fingers", "ground", (0.1, -0.1, -0.1), (0.3, 0.1, 0.05), 0.004)
    after, pair = scene.permitting([permit]).separations(placed), number(scene, "fingers", "ground")
    assert np.array_equal(np.delete(after, pair, axis=1), np.delete(before, pair, axis=1))
    allowed = (permit.inside(tips) >= 0.0) & (before[:, pair] >= -0.004)
    assert np.array_equal(after[:, pair] >= scene.margin, allowed | (before[:, pair] >= scene.margin))
    assert allowed.any()
    assert not allowed.all()


def test_what_touches_is_permitted_for_the_request_that_says_so_and_is_slow(scene: Scene, config: Config) -> None:
    low = bent(scene, config)
    sim = rigid(config, ABOVE)
    with pytest.raises(RequestError, match="fingers and ground") as refused:
        sim.start(low)
    assert refused.value.code == "collision"
    with pytest.raises(RequestError, match="fingers and ground"):
        sim.start(low, may_touch=[replace_pair(GROUND, "palm")])
    with pytest.raises(RequestError, match="fingers and ground"):
        sim.start(low, may_touch=[GROUND.model_copy(update={"high_m": [1.0, 1.0, 0.2], "low_m": [0.9, 0.9, 0.1]})])
    slow = sim.start(low, may_touch=[GROUND])
    assert max(sim.core.order.stride[:6]) == config.step // 10
    sim.until(Mode.ARMED)
    assert slow > 0.0
    lower = low + np.array([0.0, 0.05, 0.0, 0.0, 0.0, 0.0])
    pair = number(scene, "fingers", "ground")
    deeper = scene.separations(scene.frames(np.array([low, lower])))[:, pair]
    assert deeper[1] < deeper[0]
    with pytest.raises(RequestError, match="fingers and ground"):
        sim.start(lower)
    sim.start(2 * low - lower)


def replace_pair(entry: ContactEntry, first: str) -> ContactEntry:
    return entry.model_copy(update={"first": first})


def test_a_pair_that_touches_gives_no_other_pair_room(scene: Scene, config: Config) -> None:
    """Standing at 5 mm, by permission, an arm keeps the whole margin of everything else."""
    low = bent(scene, config)
    placed = scene.frames(low[None])
    guard = CollisionGuard(scene, None)
    assert scene.separations(placed).min() < 0.02
    free = guard._required(guard.bodies(0.0)[0], low)
    touched = replace(guard, touched=frozenset({frozenset(("fingers", "ground"))}))
    held = touched._required(touched.bodies(0.0)[0], low)
    pair = number(scene, "fingers", "ground")
    assert (np.delete(held, pair) == scene.margin).all()
    assert held[pair] == pytest.approx(scene.separations(placed)[0, pair])
    assert (np.delete(free, pair) < scene.margin).all()


def test_the_depth_is_what_the_force_allows_by_the_stiffness_and_none_without_a_model(config, scene) -> None:
    low = bent(scene, config)
    permit = ContactPermit("fingers", "ground", (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0), 0.02)
    (stiff,) = permits(scene, None, [Contact(permit, 5.0)], low[None], 0.0)
    assert stiff.depth == 0.0
    depths = [next(permits(scene, soft(config), [Contact(permit, f)], low[None], 0.0)).depth for f in (0.1, 0.2, 50.0)]
    assert depths[1] == pytest.approx(2 * depths[0])
    assert depths[2] == 0.02
    # The joints' springs alone: compliance along the vertical is the sum of k_j (dz/dq_j)^2.
    tips = np.array([scene.frames(low + 1e-6 * np.outer([1, -1], e))[:, -1, 2, 3] for e in np.eye(6)])
    slope = (tips[:, 0] - tips[:, 1]) / 2e-6
    assert depths[0] / 0.1 == pytest.approx(0.05 * float(slope @ slope), rel=0.15)


def test_two_parts_of_the_arm_may_never_touch(scene: Scene) -> None:
    with pytest.raises(LrmError, match="both of the arm"):
        scene.permitting([ContactPermit("link 1", "palm", (-1.0,) * 3, (1.0,) * 3)])
    with pytest.raises(LrmError, match="moon"):
        scene.permitting([ContactPermit("fingers", "moon", (-1.0,) * 3, (1.0,) * 3)])


@given(st.integers(0, 10_000))
@example(350)
@examples(6, 12)
def test_the_independent_distances_are_those_of_the_scene(seed: int) -> None:
    """Of arms among boxes, a sphere and a map; those within the margin to 20 um."""
    arm, rng = cluttered_arm(seed), np.random.default_rng(seed)
    rough = tuple(map(tuple, rng.normal(0.0, 0.1, (4, 5))))
    place = tuple(rng.normal(0.0, 0.4, 3).tolist())
    around = [
        Capsule("ball", WORLD, place, place, 0.05),
        HeightField("map", (-0.4, -0.3, -0.2), 0.2, rough, (0.1, 0.2, 0)),
    ]
    scene, q = Scene.of(arm, around=around), rng.uniform(-1.5, 1.5, (300, 6))
    theirs = bodies_apart(arm, link_frames(arm, q), around, MARGIN)
    ours = scene.separations(scene.frames(q))
    assert {frozenset(pair) for pair in theirs} == {frozenset(pair) for pair in scene.names.tolist()}
    for number, (first, second) in enumerate(scene.names.tolist()):
        found = theirs.get((first, second), theirs.get((second, first)))
        mine = ours[:, number] if second != "map" else np.maximum(ours[:, number], -scene.radii[number])
        near = mine < MARGIN
        assert found[near] == pytest.approx(mine[near], abs=2e-5), (first, second)
        assert (found[~near] > MARGIN - 2e-5).all()


@given(st.integers(0, 10_000))
@settings(max_examples=3, deadline=None)
def test_no_sequence_of_requests_makes_a_permission_leak(seed: int) -> None:
    """To another pair, place, depth, request or client; the others keep the margin in every tick, and so do obstacles
    that come, move and go meanwhile. Told by distances that share no code with the guard's."""
    result = GuardedSequence(seed, FASTER).run(6, contacts=True)
    assert result.kept, result


@pytest.mark.parametrize("seed", [4241, 8121, *soak(8030, 8525, 8963)])
def test_an_arm_that_is_armed_in_an_overlap_comes_no_deeper_by_a_permission(seed: int) -> None:
    """Sequences that once did: by the room of another pair, or where the depth of an axis in a box was left out."""
    result = GuardedSequence(seed, 5).run(4, contacts=True)
    assert result.kept, result
