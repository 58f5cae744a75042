"""Obstacles that `cmd/scene` tells of: the guard knows them at once, nobody else's are touched, the old are dropped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import pytest

from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene
from lrm_math.ik.nominal import NominalSolver
from lrmd.config import SECOND, Config, load_config
from lrmd.control.requests import SCENES_PER_S
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import deploy
from lrmd.ik.planner import NoPlan
from lrmd.ik.service import IkService
from lrmd.messages.codec import MessageError, pack, unpack
from lrmd.messages.control import SceneCommand
from lrmd.messages.kinematics import GoalEntry, IkRequest, PlanRequest
from lrmd.messages.surroundings import MOST_CELLS, MOST_HEIGHTS, MOST_OBSTACLES, ObstacleEntry, packed, unpacked
from lrmd.ramp.shared_memory import SharedRecords
from lrmd.safety.collision_guard import CollisionGuard
from tests.daemon.safety.test_contact import ABOVE, rigid
from tests.support.daemon.armed_daemon import ArmedDaemon
from tests.support.daemon.in_memory_daemon import CONFIG

AWAY = ABOVE + np.array([-0.8, -0.3, 0.0, 0.0, 0.0, 0.0])


@pytest.fixture
def config() -> Config:
    return replace(load_config(CONFIG), stagger=20_000_000)


@pytest.fixture
def sim(config: Config) -> ArmedDaemon:
    return rigid(config, ABOVE)


def sphere(name: str, place: Any, radius: float = 0.03) -> ObstacleEntry:
    return ObstacleEntry(name=name, shape="sphere", position_m=list(place), radius_m=radius)


def on_the_way(config: Config, share: float) -> ObstacleEntry:
    """A sphere where the tip passes."""
    q = ABOVE + share * (AWAY - ABOVE)
    return sphere("stone", NominalSolver.of(config.arm).frames(q[None])[0, -1, :3, 3])


def rock(config: Config, share: float, name: str = "map") -> ObstacleEntry:
    """A map of flat ground below everything, with one high column where the tip passes."""
    q = ABOVE + share * (AWAY - ABOVE)
    x, y, z = NominalSolver.of(config.arm).frames(q[None])[0, -1, :3, 3].tolist()
    heights: list[float | None] = [-0.3] * 1200
    heights[20 * 40 + 15] = z
    heights[0] = None
    return ObstacleEntry(
        name=name, shape="heightfield", position_m=[x - 15.5 * 0.03, y - 20.5 * 0.03, 0.0], cell_m=0.03, columns=40,
        heights_m=heights,
    )  # fmt: skip


def tell(sim: ArmedDaemon, *put: ObstacleEntry, owner: str = "map", **more: Any) -> None:
    sim.keep(SECOND // SCENES_PER_S // sim.config.tick + 1)
    sim.core.handle(SceneCommand(owner=owner, put=list(put), **more), sim.now)


@pytest.mark.parametrize("obstacle", [on_the_way, rock])
def test_a_move_into_an_obstacle_is_refused_and_possible_again_without_it(
    sim: ArmedDaemon, config: Config, obstacle: Callable[[Config, float], ObstacleEntry]
) -> None:
    stone = obstacle(config, 0.8)
    tell(sim, stone)
    with pytest.raises(RequestError, match=rf"\b{stone.name}\b.* would come"):
        sim.start(AWAY)
    tell(sim, remove=[stone.name])
    sim.start(AWAY)
    assert sim.core.mode is Mode.MOVING


@pytest.mark.parametrize("obstacle", [on_the_way, rock])
def test_an_obstacle_before_a_moving_arm_stops_it_and_one_beside_its_way_does_not(
    sim: ArmedDaemon, config: Config, obstacle: Callable[[Config, float], ObstacleEntry]
) -> None:
    sim.start(AWAY)
    sim.keep(20)
    tell(sim, sphere("far", (0.0, 0.8, 0.8)))
    assert sim.core.mode is Mode.MOVING
    tell(sim, obstacle(config, 0.9))
    assert sim.core.mode is Mode.HOLDING
    assert "motion_stopped" in [event.code for event in sim.core.events]


@pytest.mark.long
def test_a_jog_stops_before_a_column_and_a_map_inside_the_arm_is_refused(sim: ArmedDaemon, config: Config) -> None:
    tell(sim, rock(config, 0.6), max_age_s=None)
    scene = Scene.of(config.arm, around=sim.core.obstacles.shapes())
    with_map = ["map" in pair for pair in scene.names.tolist()]
    visited = sim.jogged(AWAY - ABOVE)
    apart = scene.separations(scene.frames(visited))[:, with_map]
    assert apart.min() >= min(scene.margin, apart[0].min()) - 1e-5
    assert apart.min() < scene.margin + 1e-2 < apart[0].min()
    with pytest.raises(RequestError, match=r"'map' would be inside"):
        tell(sim, rock(config, share_of(visited[-1])))


def share_of(q: Array) -> float:
    """The share of the way to `AWAY` at which the arm stands."""
    way = AWAY - ABOVE
    return float((q - ABOVE) @ way / (way @ way))


@pytest.mark.long
def test_plans_and_inverse_kinematics_know_a_map(config: Config) -> None:
    """A plan goes round a column that the straight way meets; a goal in it is a collision."""
    plain = replace(config, model=None)
    service = IkService.of(plain, deploy(plain)).among([rock(config, 0.5)])
    guard = CollisionGuard(Scene.of(config.arm, around=[rock(config, 0.5).built()]), None)
    assert not guard.check(np.array([ABOVE, AWAY]), 0.0)[0].free
    path = service.plan(PlanRequest(from_rad=ABOVE.tolist(), to_rad=AWAY.tolist()), lambda: None)
    assert not isinstance(path, NoPlan), path
    assert len(path) > 2
    guard(path, 0.0)
    x, y, z = NominalSolver.of(config.arm).frames((0.5 * (ABOVE + AWAY))[None])[0, -1, :3, 3].tolist()
    (answer,) = service.inverse(IkRequest(goals=[GoalEntry(position_m=[x, y, z])]))
    assert answer.verdict == "collision"
    assert "map" in answer.bodies


def test_maps_have_so_many_heights_in_all(sim: ArmedDaemon) -> None:
    def flat(name: str, count: int) -> ObstacleEntry:
        return ObstacleEntry(
            name=name, shape="heightfield", position_m=[2.0, 2.0, 0.0], cell_m=0.01, columns=count,
            heights_m=[0.0] * count,
        )  # fmt: skip

    tell(sim, flat("a", MOST_HEIGHTS), flat("b", MOST_CELLS - MOST_HEIGHTS))
    with pytest.raises(RequestError, match="4097 heights; heightfields have at most 4096 in all"):
        tell(sim, flat("c", 1))
    assert sorted(sim.core.obstacles.known) == ["a", "b"]
    tell(sim, flat("b", 7))
    tell(sim, flat("c", 1))


def test_an_obstacle_inside_the_arm_is_refused_and_stops_a_motion(sim: ArmedDaemon, config: Config) -> None:
    sim.start(AWAY)
    sim.keep(20)
    with pytest.raises(RequestError, match=r"'stone' would be inside") as refused:
        tell(sim, on_the_way(config, 0.0))
    assert refused.value.code == "obstacle"
    assert sim.core.mode is Mode.HOLDING
    assert not sim.core.obstacles.known


def test_a_near_obstacle_gives_no_other_pair_room(sim: ArmedDaemon, config: Config) -> None:
    scene = Scene.of(config.arm)
    tip = scene.frames(ABOVE[None])[0, -1, :3, 3]
    tell(sim, sphere("near", tip - np.array([0.0, 0.0, 0.055]), 0.02))
    guard = sim.core.motion_check.guard
    required = guard._required(guard.bodies(0.0)[0], ABOVE)  # type: ignore[union-attr]
    plain = np.array(["near" not in pair for pair in guard.scene.names.tolist()])  # type: ignore[union-attr]
    assert (required[plain] == scene.margin).all()
    assert required.min() < scene.margin


def test_only_its_owner_changes_an_obstacle_and_old_ones_are_dropped(sim: ArmedDaemon) -> None:
    stone = sphere("stone", (0.0, 0.8, 0.8))
    tell(sim, stone, max_age_s=1.0)
    for more in ({}, {"remove": ["stone"]}):
        with pytest.raises(RequestError, match="is an obstacle of map"):
            tell(sim, *([] if more else [stone]), owner="other", **more)
    with pytest.raises(RequestError, match="shape of the arm file"):
        tell(sim, sphere("rover", (0.0, 0.8, 0.8)))
    tell(sim, sphere("rock", (0.0, -0.8, 0.8)), owner="other", max_age_s=None)
    sim.keep(2 * SECOND // sim.config.tick)
    assert list(sim.core.obstacles.known) == ["rock"]
    assert [e.detail or e.text for e in sim.core.events if e.code == "obstacle_dropped"] != []
    with pytest.raises(RequestError, match="at most 32"):
        tell(sim, *(sphere(f"s{i}", (0.0, 0.8, 0.8)) for i in range(MOST_OBSTACLES)), owner="other")
    assert list(sim.core.obstacles.known) == ["rock"]


def test_what_is_malformed_is_refused_with_its_field() -> None:
    good = {"name": "a", "shape": "sphere", "position_m": [0.0, 0.0, 0.0], "radius_m": 0.1}
    for wrong in (
        {"shape": "box"},
        {"radius_m": -1.0},
        {"size_m": [1.0, 1.0, 1.0]},
        {"name": ""},
        {"position_m": [0.0]},
        {"shape": "heightfield"},
        {"shape": "heightfield", "radius_m": None, "cell_m": 0.001, "columns": 1, "heights_m": [0.0]},
        {"shape": "heightfield", "radius_m": None, "cell_m": 0.1, "columns": 2, "heights_m": [0.0]},
        {"shape": "heightfield", "radius_m": None, "cell_m": 0.1, "columns": 1, "heights_m": [float("nan")]},
        {"shape": "heightfield", "radius_m": None, "cell_m": 0.1, "columns": 1, "heights_m": [0.0] * 2049},
    ):
        data = pack(SceneCommand(owner="x"))
        content = msgpack.unpackb(data) | {"put": [good | wrong]}
        with pytest.raises(MessageError, match=r"put\.0"):
            unpack(SceneCommand, msgpack.packb(content))


def test_the_largest_scene_fits_into_the_shared_memory() -> None:
    largest = [
        ObstacleEntry(
            name=f"{i:02d}" + "\N{SNOWMAN WITHOUT SNOW}" * 62, shape="box", position_m=[1.1, 2.2, 3.3],
            size_m=[0.1, 0.2, 0.3], rotation_rad=[0.1, 0.2, 0.3],
        )
        for i in range(MOST_OBSTACLES - 2)
    ]  # fmt: skip
    largest += [
        ObstacleEntry(
            name=f"{i:02d}" + "\N{SNOWMAN WITHOUT SNOW}" * 62, shape="heightfield", position_m=[1.1, 2.2, 3.3],
            cell_m=0.123, columns=2, heights_m=[1.0 / 3] * MOST_HEIGHTS, rotation_rad=[0.1, 0.2, 0.3],
        )
        for i in range(30, 30 + MOST_CELLS // MOST_HEIGHTS)
    ]  # fmt: skip
    shared = SharedRecords.create()
    assert shared.read_scene() is None
    shared.write_scene(packed(largest))
    assert unpacked(shared.read_scene() or b"") == tuple(largest)


def test_a_flood_of_scenes_is_refused_before_it_costs_anything(sim: ArmedDaemon) -> None:
    tell(sim, sphere("stone", (0.0, 0.8, 0.8)))
    with pytest.raises(RequestError, match="10 times a second") as refused:
        sim.core.handle(SceneCommand(owner="map"), sim.now)
    assert refused.value.code == "busy"
    assert refused.value.retryable
