"""The capability map keeps geometry's laws, agrees with forward sampling and with shells known by hand."""

from __future__ import annotations

import csv
import json
import math
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.design.workspace.arm_variants import lengthened, parse_variant
from lrm_ident.design.workspace.capability_map import CapabilityMap, capability_map, pose_solver
from lrm_ident.design.workspace.orientation_grid import directions, rotations
from lrm_ident.design.workspace.voxel_grid import VoxelGrid, bounding_ball, default_study, grid_around, parse_area
from lrm_math.arm.arm import Arm, Joint, Placement
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene, clearance
from lrm_math.errors import LrmError, UnknownName
from lrm_math.ik.goal import pose
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames
from tests.support.commands import stderr_of, stdout_of
from tests.support.sweep import examples

TOOLS = rotations(directions(12), 4)
COARSE = 0.09
UPPER, FORE, TOOL_LENGTH = 0.25, 0.15, 0.1
MIRROR = np.diag([1.0, -1.0, 1.0])


def shell_arm(tool: float = 0.0, limit: float = math.pi) -> Arm:
    """Yaw, two links, and a wrist whose three axes meet: its wrist fills the shell between |a − b| and a + b."""
    shape = (
        (0.0, 0.0, 90.0), (0.0, UPPER, 0.0), (0.0, 0.0, 90.0), (FORE, 0.0, -90.0), (0.0, 0.0, 90.0), (0.0, 0.0, 0.0),
    )  # fmt: skip
    joints = tuple(Joint(0.0, d, a, math.radians(alpha), None, -limit, limit) for d, a, alpha in shape)
    return Arm("shell", (0.0, 0.0, -9.81), Placement(), joints, Placement(z=tool), ())


def limited(arm: Arm, lower: list[float], upper: list[float]) -> Arm:
    joints = tuple(replace(j, lower=a, upper=b) for j, a, b in zip(arm.joints, lower, upper, strict=True))
    return replace(arm, joints=joints)


def at(arm: Arm, q: Array) -> Array:
    """(N, n + 2, 4, 4), frames by the forward chain, which the map never asks."""
    chain = chain_of(arm)
    return frames(chain, chain.values(list(np.ascontiguousarray(q.T))), len(q))


def random_angles(arm: Arm, count: int) -> Array:
    low, high = np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    return np.random.default_rng(4).uniform(low, high, (count, arm.dof))


def plain(arm: Arm, step: float = COARSE, tools: Array = TOOLS) -> CapabilityMap:
    return capability_map(arm, grid_around([arm], step), tools)


@pytest.mark.parametrize("count", [12, 42, 162])
def test_directions_are_spread_evenly(count: int) -> None:
    along = directions(count)
    assert along.shape == (count, 3)
    assert np.linalg.norm(along, axis=1) == pytest.approx(np.ones(count))
    assert along.T @ along == pytest.approx(np.eye(3) * count / 3, abs=1e-9)
    nearest = np.degrees(np.arccos(np.clip(np.sort(along @ along.T, axis=1)[:, -2], -1.0, 1.0)))
    assert nearest.max() < 1.3 * nearest.min()
    mirrored = along @ MIRROR
    assert np.abs(mirrored[:, None] - along).max(axis=2).min(axis=1).max() < 1e-9


def test_rotations_are_tool_frames_along_their_directions() -> None:
    along = directions(42)
    turns = rotations(along, 3)
    assert np.einsum("dria,drib->drab", turns, turns) == pytest.approx(
        np.broadcast_to(np.eye(3), turns.shape), abs=1e-12
    )
    assert np.linalg.det(turns) == pytest.approx(np.ones((42, 3)))
    assert turns[..., 2] == pytest.approx(np.broadcast_to(along[:, None], (42, 3, 3)))
    turned = np.einsum("dia,dib->dab", turns[:, 0], turns[:, 1])
    assert np.trace(turned, axis1=1, axis2=2) == pytest.approx(np.full(42, 1 + 2 * math.cos(2 * math.pi / 3)))


def test_counts_that_cannot_be_spread_evenly() -> None:
    for count in (-1, 0, 2, 6, 13, 40):
        with pytest.raises(LrmError, match="12, 42"):
            directions(count)
    with pytest.raises(LrmError, match="at least 1"):
        rotations(directions(12), 0)


def test_a_wrist_without_limits_takes_every_orientation_in_its_shell() -> None:
    found = plain(shell_arm(), 0.06)
    distance = np.linalg.norm(found.grid.centres, axis=1)
    inside = (distance > UPPER - FORE) & (distance < UPPER + FORE)
    assert inside.any()
    assert np.array_equal(found.index, inside.astype(float))
    assert np.array_equal(found.directions, found.index)
    assert found.volume == pytest.approx(inside.sum() * 0.06**3)


def test_a_tool_turns_the_shell_into_shares_known_by_hand() -> None:
    found = plain(shell_arm(TOOL_LENGTH), 0.06)
    wrist = np.linalg.norm(found.grid.centres[:, None] - TOOL_LENGTH * directions(12), axis=2)
    expected = ((wrist > UPPER - FORE) & (wrist < UPPER + FORE)).mean(axis=1)
    assert 0.0 < np.median(expected[expected > 0]) < 1.0
    assert found.index == pytest.approx(expected, abs=1e-12)
    assert found.directions == pytest.approx(expected, abs=1e-12)


@pytest.mark.slow
def test_the_volume_comes_closer_with_finer_cells() -> None:
    true = 4 / 3 * math.pi * ((UPPER + FORE) ** 3 - (UPPER - FORE) ** 3)
    tools = rotations(directions(12), 1)
    assert plain(shell_arm(), 0.025, tools).volume == pytest.approx(true, rel=0.01)


@pytest.mark.slow
@examples(12, 25)
@given(
    st.lists(st.floats(-100, -10), min_size=6, max_size=6),
    st.lists(st.floats(10, 100), min_size=6, max_size=6),
    st.lists(st.floats(0, 60), min_size=6, max_size=6),
)
def test_wider_limits_never_take_anything_away(lower: list[float], upper: list[float], more: list[float]) -> None:
    rover = load_arm("lrm-rover")
    low, high, wider = np.radians(lower), np.radians(upper), np.radians(more)
    narrow = plain(limited(rover, low.tolist(), high.tolist()), 0.12)
    wide = plain(limited(rover, (low - wider).tolist(), (high + wider).tolist()), 0.12)
    assert (wide.index >= narrow.index).all()
    assert (wide.directions >= narrow.directions).all()
    for found in (narrow, wide):
        assert ((found.index >= 0) & (found.index <= found.directions) & (found.directions <= 1)).all()


@pytest.mark.parametrize("clear", [False, True])
def test_a_symmetric_arm_has_a_symmetric_map(rover: Arm, clear: bool) -> None:
    q = random_angles(rover, 20)
    original, other = (at(rover, angles)[:, -1] for angles in (q, q * [-1, 1, -1, 1, -1, 1]))
    assert other[:, :3, 3] == pytest.approx(original[:, :3, 3] @ MIRROR), "the arm is not symmetric"
    assert other[:, :3, :3] == pytest.approx(MIRROR @ original[:, :3, :3] @ MIRROR), "the arm is not symmetric"
    grid = grid_around([rover], COARSE)
    found = capability_map(rover, grid, TOOLS, Scene.of(rover) if clear else None)
    assert found.index.any()
    by_axis = grid.by_axis(found.index)
    assert grid.axis(1) == pytest.approx(-grid.axis(1)[::-1])
    assert np.array_equal(by_axis, by_axis[:, ::-1])


def test_a_map_turns_with_its_arm(rover: Arm) -> None:
    bare = replace(rover, base=replace(rover.base, beta=0.0))
    round_about = replace(bare, base=replace(bare.base, x=-bare.base.x, y=-bare.base.y, gamma=math.pi))
    grid = grid_around([bare, round_about], COARSE)
    one, other = (grid.by_axis(capability_map(arm, grid, TOOLS).index) for arm in (bare, round_about))
    assert one.any()
    assert np.array_equal(one, other[::-1, ::-1])


@given(st.floats(0.3, 3.0))
@examples(5, 10)
def test_an_arm_twice_the_size_has_the_same_map(scale: float) -> None:
    rover = load_arm("lrm-rover")

    def placed(p: Placement) -> Placement:
        return replace(p, x=p.x * scale, y=p.y * scale, z=p.z * scale)

    joints = tuple(
        replace(j, d=j.d * scale, a=j.a * scale, extra_z=None if j.extra_z is None else j.extra_z * scale)
        for j in rover.joints
    )
    other = replace(rover, base=placed(rover.base), joints=joints, tool=placed(rover.tool))
    grid = grid_around([rover], 0.12)
    scaled = capability_map(other, replace(grid, step=grid.step * scale), TOOLS)
    assert np.array_equal(scaled.index, capability_map(rover, grid, TOOLS).index)


def test_forward_sampling_never_leaves_the_map(rover: Arm) -> None:
    """Every place that a random pose reaches touches a cell with an index above zero, and none is outside the grid."""
    found = plain(rover, 0.06, rotations(directions(42), 4))
    grid = found.grid
    tcp = at(rover, random_angles(rover, 30_000))[:, -1, :3, 3]
    cells = np.floor(tcp / grid.step).astype(np.int64) - grid.first
    assert ((cells >= 0) & (cells < grid.count)).all()
    reached = np.pad(grid.by_axis(found.index) > 0, 1)
    near = np.zeros(len(tcp), dtype=np.bool_)
    for offset in np.ndindex(3, 3, 3):
        i, j, k = (cells + offset).T
        near |= reached[i, j, k]
    assert near.all()


@pytest.mark.long
def test_the_orientation_of_a_forward_pose_can_be_taken_there(rover: Arm) -> None:
    """A grid of one cell round the place that random angles lead to, asked for that orientation only."""
    for T in at(rover, random_angles(rover, 60))[:, -1]:
        step = 0.05
        around = replace(rover, base=replace(rover.base, **dict(zip("xyz", _shifted(rover, T, step), strict=True))))
        found = capability_map(around, VoxelGrid(step, (0, 0, 0), (1, 1, 1)), T[None, None, :3, :3])
        assert found.index.tolist() == [1.0]


def _shifted(arm: Arm, T: Array, step: float) -> list[float]:
    """Place of the base for the pose T to lie in the middle of the cell at the origin."""
    base = np.array([arm.base.x, arm.base.y, arm.base.z])
    shifted: list[float] = (base + 0.5 * step - T[:3, 3]).tolist()
    return shifted


def test_shapes_and_margins_only_take_away(rover: Arm) -> None:
    grid = grid_around([rover], COARSE)
    scene = Scene.of(rover)
    maps = [
        capability_map(rover, grid, TOOLS),
        *(capability_map(rover, grid, TOOLS, scene, margin) for margin in (0.0, 0.03, 0.1)),
    ]
    for looser, tighter in pairwise(maps):
        assert (tighter.index <= looser.index).all()
        assert tighter.volume < looser.volume
    assert np.array_equal(capability_map(rover, grid, TOOLS, scene).index, maps[2].index)
    below = grid.centres[:, 2] < 0
    assert maps[0].index[below].any()
    assert not maps[1].index[below].any(), "inside the ground"
    with pytest.raises(LrmError, match="margin"):
        capability_map(rover, grid, TOOLS, scene, -0.01)


def test_every_branch_gets_its_chance_to_keep_clear(rover: Arm) -> None:
    """A goal counts if any of its branches is clear; asked goal by goal, of the solver that answers single goals."""
    cells = VoxelGrid(COARSE, (-1, -2, 2), (5, 4, 4))
    scene, solver = Scene.of(rover), pose_solver(rover)
    taken = np.zeros((len(cells), *TOOLS.shape[:2]), dtype=np.bool_)
    first_only = taken.copy()
    turns = TOOLS.reshape(-1, 3, 3)
    goals = np.repeat(cells.centres, len(turns), axis=0), np.tile(turns, (len(cells), 1, 1))
    within_limits = solver.solve_batch(*goals).solved.reshape(taken.shape)
    for place in map(tuple, np.argwhere(within_limits)):
        branches = solver.solve(pose(cells.centres[place[0]], TOOLS[place[1:]])).branches
        clear = [clearance(scene, branch.q).distance[0] >= scene.margin for branch in branches]
        taken[place], first_only[place] = any(clear), bool(clear) and clear[0]
    assert (taken & ~first_only).any(), "no goal here needs a second branch"
    found = capability_map(rover, cells, TOOLS, scene)
    assert found.index == pytest.approx(taken.mean(axis=(1, 2)))
    assert found.directions == pytest.approx(taken.any(axis=2).mean(axis=1))


def test_nothing_leaves_the_ball(rover: Arm, lab: Arm) -> None:
    for arm in (rover, lab, shell_arm(TOOL_LENGTH)):
        centre, radius = bounding_ball(arm)
        away = np.linalg.norm(at(arm, random_angles(arm, 3000))[:, -1, :3, 3] - centre, axis=1)
        assert away.max() <= radius + 1e-12
    assert bounding_ball(shell_arm(TOOL_LENGTH))[1] == pytest.approx(UPPER + FORE + TOOL_LENGTH)


def test_areas(rover: Arm) -> None:
    found = plain(rover)
    everything = parse_area("all=-2000:2000,-2000:2000,-2000:2000")
    half = [parse_area("left=-2000:2000,0:2000,-2000:2000"), parse_area("right=-2000:2000,-2000:0,-2000:2000")]
    assert found.within(everything).index == pytest.approx(found.index.mean())
    assert found.within(everything).covered * len(found.grid) * found.grid.cell_volume == pytest.approx(found.volume)
    assert found.score(half) == pytest.approx(np.mean([found.within(area).index for area in half]))
    assert found.score([*half, everything]) == pytest.approx(found.index.mean()), "no cell counts twice"
    with pytest.raises(LrmError, match="areas"):
        found.score([])
    for words in ("far=5000:5100,0:100,0:100", "tiny=1:2,1:2,1:2"):
        with pytest.raises(LrmError, match=r"far|tiny"):
            found.within(parse_area(words))
    for words in (
        "ground",
        "ground=1:2,1:2",
        "ground=2:1,0:1,0:1",
        "=0:1,0:1,0:1",
        "g=0:nan,0:1,0:1",
        "g=0:1e3,0:1,0:1",
    ):
        with pytest.raises(LrmError, match="area"):
            parse_area(words)


@pytest.mark.long
@pytest.mark.parametrize("link", range(1, 7))
def test_a_longer_link_is_longer_and_nothing_else(rover: Arm, link: int) -> None:
    longer = lengthened(rover, link, 0.02)
    q = random_angles(rover, 5)
    before, after = at(rover, q), at(longer, q)

    def lengths(stands: Array) -> Array:
        return np.linalg.norm(np.diff(stands[:, :, :3, 3], axis=1), axis=2)

    far = link if link < rover.dof else link + 1
    gained = np.zeros(rover.dof + 1)
    gained[far - 1] = 0.02
    assert lengths(after) - lengths(before) == pytest.approx(np.broadcast_to(gained, (5, 7)), abs=1e-12)
    assert after[..., :3, :3] == pytest.approx(before[..., :3, :3])
    again = lengthened(longer, link, -0.02)
    for end in ("start", "end"):
        was, now = (np.array([getattr(c, end) for c in arm.shapes.capsules]) for arm in (rover, again))
        assert now == pytest.approx(was, abs=1e-12)
    assert at(again, q) == pytest.approx(before)


def test_shapes_stretch_with_their_link(rover: Arm) -> None:
    """Capsules that reach from joint to joint still do; the fingers keep their place between wrist and TCP."""
    changed = parse_variant(rover, "link1+15mm,link2+20mm,link3-10mm,link4-20mm,link5+5mm").arm
    stands = at(changed, np.zeros((1, 6)))[0]
    for capsule in changed.shapes.capsules[:5]:
        start, end = (
            stands[capsule.frame, :3, :3] @ p + stands[capsule.frame, :3, 3] for p in (capsule.start, capsule.end)
        )
        assert start == pytest.approx(stands[capsule.frame - 1, :3, 3], abs=1e-9)
        assert end == pytest.approx(stands[capsule.frame, :3, 3], abs=1e-9)
    bare = replace(rover, tool=replace(rover.tool, z=0.0))
    grown = parse_variant(bare, "tool_z_mm=50").arm
    for was, now in zip(bare.shapes.capsules, grown.shapes.capsules, strict=True):
        assert (*now.start, *now.end) == pytest.approx((*was.start, *was.end), abs=1e-12), (
            "no length, nothing to stretch"
        )
    twice = lengthened(rover, 6, rover.tool.z)
    for was, now in zip(rover.shapes.capsules[5:], twice.shapes.capsules[5:], strict=True):
        along = {6: 1, 7: 2}[was.frame]
        assert np.array(now.start)[along] == pytest.approx(2 * was.start[along])
        assert np.array(now.end)[along] == pytest.approx(2 * was.end[along])


def test_variants_in_words(rover: Arm) -> None:
    found = parse_variant(rover, " base_beta_deg=45, link2-10mm ,joint3_d_mm=50,tool_z_mm=100.5,joint4_theta_deg=-5")
    arm = found.arm
    assert math.degrees(arm.base.beta) == pytest.approx(45)
    assert arm.joints[1].extra_z == pytest.approx(0.09351)
    assert (arm.joints[2].d, arm.tool.z) == pytest.approx((0.05, 0.1005))
    assert math.degrees(arm.joints[3].theta) == pytest.approx(-5)
    assert found.name == "base_beta_deg=45,link2-10mm,joint3_d_mm=50,tool_z_mm=100.5,joint4_theta_deg=-5"
    for words in ("link9+1mm", "joint9_d_mm=1", "base_d_mm=1", "joint1_x_mm=1", "joint1_d_deg=1", "nothing_x_mm=0"):
        with pytest.raises(UnknownName):
            parse_variant(rover, words)
    for words in ("", "link2", "link2+1", "link2=5mm", "base_beta_deg=nan", "base_beta_deg=400", "link2-200mm", "a,b"):
        with pytest.raises(LrmError):
            parse_variant(rover, words)
    with pytest.raises(LrmError, match="joint2_a_mm"):
        parse_variant(
            replace(rover, joints=(rover.joints[0], replace(rover.joints[1], a=0.1), *rover.joints[2:])), "link2+1mm"
        )


def test_the_thesis_study_can_be_read(rover: Arm) -> None:
    """2 tilts, 3 lengths of link 2, 3 of link 4: 18 arms, the shipped one among them."""
    study = default_study(rover.name)
    arms = [rover, *(parse_variant(rover, words).arm for words in study.variants)]
    shapes = {(round(math.degrees(a.base.beta)), a.joints[1].extra_z, a.joints[3].extra_z) for a in arms}
    assert len(shapes) == len(arms) == 18
    assert default_study("of my own").variants == ()


@pytest.mark.slow
def test_the_command(tmp_path: Path) -> None:
    result, picture = tmp_path / "reach.json", tmp_path / "reach.svg"
    words = ("--variant", "base_beta_deg=45", "--variant", "link2-10mm,link4-20mm", "--step-mm", 90, "--directions", 12)
    said = stdout_of("reach", "lrm-rover", *words, "--json", result, "--figure", picture)
    assert "goals/s" in said
    assert all(name in said for name in ("as it is", "base_beta_deg=45", "link2-10mm,link4-20mm"))
    found = json.loads(result.read_text())
    assert found["schema"] == "lrm/reach/1"
    assert found["goals"] == 3 * found["cells"] * 48
    with picture.with_suffix(".csv").open() as file:
        rows = list(csv.DictReader(file))
    for each in found["variants"]:
        index = np.array([float(row[f"index {each['name']}".replace(",", " ")]) for row in rows])
        assert np.count_nonzero(index) * 0.09**3 * 1e3 == pytest.approx(each["volume_l"])
        assert index[index > 0].mean() == pytest.approx(each["reachable"]["index"], abs=1e-6)
    best = max(found["variants"], key=lambda each: each["all_areas_index"])
    assert best["name"] == found["best"]
    assert picture.read_text().lstrip().startswith("<?xml")


def test_the_command_without_shapes_or_variants(tmp_path: Path, lab: Arm) -> None:
    result = tmp_path / "reach.json"
    grid = ("--step-mm", 120, "--directions", 12, "--rolls", 1)
    stdout_of("reach", "lrm-lab", "--no-collisions", *grid, "--json", result)
    found = json.loads(result.read_text())
    assert [each["name"] for each in found["variants"]] == ["as it is"]
    assert found["collisions"] is False
    grid = grid_around([lab], 0.12)
    assert found["variants"][0]["volume_l"] == pytest.approx(
        capability_map(lab, grid, rotations(directions(12), 1)).volume * 1e3
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("no-such-arm",), "no such arm"),
        (("two-joint",), "six"),
        (("lrm-rover", "--variant", "link2+20"), "link2\\+20"),
        (("lrm-rover", "--variant", "link7+20mm"), "link6"),
        (("lrm-rover", "--variant", "base_delta_deg=4"), "beta"),
        (("lrm-rover", "--variant", "link2+9mm", "--variant", "link2+9mm"), "twice"),
        (("lrm-rover", "--area", "ground"), "NAME=X:X"),
        (("lrm-rover", "--area", "far=9000:9100,0:100,0:100"), "far"),
        (("lrm-rover", "--area", "a=0:99,0:99,0:99", "--area", "a=0:100,0:100,0:100"), "twice"),
        (("lrm-rover", "--step-mm", "0"), "above zero"),
        (("lrm-rover", "--step-mm", "nan"), "above zero"),
        (("lrm-rover", "--step-mm", "1"), "or more"),
        (("lrm-rover", "--directions", "40"), "42"),
        (("lrm-rover", "--rolls", "0"), "at least 1"),
        (("lrm-rover", "--margin-mm", "-1"), "margin"),
        (("lrm-rover", "--may-touch", "fingers"), "two shapes"),
        (("lrm-rover", "--may-touch", "fingers:moon"), "moon"),
    ],
)
def test_bad_input_is_one_clear_line(words: tuple[str, ...], says: str, tmp_path: Path) -> None:
    result = tmp_path / "reach.json"
    complained = stderr_of("reach", *words, "--json", result)
    assert re.search(says, complained), complained
    assert not result.exists()


def test_a_figure_does_not_write_over_the_json(tmp_path: Path) -> None:
    assert "different names" in stderr_of(
        "reach", "lrm-rover", "--figure", tmp_path / "a.png", "--json", tmp_path / "a.csv", "--step-mm", 90
    )
    words = ("reach", "lrm-lab", "--step-mm", 120, "--json", tmp_path / "b.json")
    assert "cannot draw" in stderr_of(*words, "--figure", tmp_path / "a.xyz")
    assert not list(tmp_path.iterdir())
