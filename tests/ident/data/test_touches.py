"""Touched points: read, refused, registered, fitted together with where their board stood; held out touch by touch."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.conventions import metadata_of
from lrm_ident.data.measurement_file.touched_points import known_points
from lrm_ident.data.registration.checked import load_checked
from lrm_ident.data.registration.set_up import with_set_up
from lrm_ident.data.registration.similarity import rigid_motion_between
from lrm_ident.data.rigid_motion import placement_motion
from lrm_ident.fitting.cross_validation import held_out_folds
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model, nominal_model
from lrm_ident.study.study import Study
from lrm_math.arm.arm import Arm, Placement
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.deployed_model import as_deployed, deployed_part
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.session_state import StateAfterSession
from lrm_math.model.state_after_session import state_after_session
from tests.support.sweep import examples

POINTS_MM = {"A": (0.0, 0.0, 0.0), "B": (100.0, 0.0, 0.0), "C": (100.0, 80.0, 0.0), "D": (0.0, 80.0, 20.0)}
STANDS = {
    "left": Placement(0.22, 0.08, 0.0, 0.0, 0.0, 0.7),
    "right": Placement(0.2, -0.18, 0.0, 0.0, 0.0, -0.6),
    "high": Placement(0.23, -0.02, 0.12, 0.3, 0.1, 0.0),
}
Touches = list[tuple[Array, str, str]]
"""Joint angles (rad), point and placement of each touch."""
HIDDEN = {"offsets.joint3.theta_rad": 0.03, "offsets.joint2.a_mm": -2e-3, "offsets.joint3.a_mm": 2e-3}


def at_goals(model: Model, goals: Array, seed: int) -> Array:
    """(N, n), joint angles at which the TCP is at goals (N, 3), by damped Newton steps from random ones."""
    limits = np.array([(joint.lower, joint.upper) for joint in model.arm.joints])
    rng = np.random.default_rng(seed)
    out = np.empty((len(goals), model.arm.dof))
    for row, goal in enumerate(goals):
        for _ in range(200):
            q = rng.uniform(*(0.7 * limits.T))
            for _ in range(30):
                settled = solve_equilibrium(model, poses_of(q))
                J = parameter_jacobian(settled, [f"offsets.joint{k}.theta_rad" for k in range(1, len(q) + 1)])[0]
                step = np.linalg.lstsq(J, goal - settled.tcp[0], rcond=0.05)[0]
                q = np.clip(q + np.clip(step, -0.3, 0.3), *limits.T)
            if np.linalg.norm(solve_equilibrium(model, poses_of(q)).tcp[0] - goal) < 1e-5:
                break
        out[row] = q
    return out


def write_touches(folder: Path, rows: Touches, beside: str) -> Path:
    """A file of touches: joint angles (rad), point and placement of each."""
    joints = len(rows[0][0])
    header = ",".join(["pose", *(f"q{k}_deg" for k in range(1, joints + 1)), "point", "placement"])
    lines = [
        ",".join([str(n), *(f"{x:.4f}" for x in np.degrees(q)), p, where]) for n, (q, p, where) in enumerate(rows, 1)
    ]
    path = folder / "touches.csv"
    path.write_text("\n".join([header, *lines]) + "\n")
    path.with_suffix(".toml").write_text(f'schema = "lrm/measurements/1"\narm = "so101"\n{beside}\n')
    return path


def points_toml() -> str:
    return "[points]\n" + "\n".join(f"{name} = {list(place)}" for name, place in POINTS_MM.items())


@pytest.fixture(scope="module")
def touches(so101: Arm) -> Touches:
    """24 touches at three placements of an arm with hidden errors, encoders of 0.05 deg."""
    truth = model_of(so101, effects_at(so101, "offsets"), HIDDEN)
    asked = [(point, where) for where in STANDS for point in (*POINTS_MM, *POINTS_MM)]
    goals = np.array([(placement_motion(STANDS[w]) @ [*np.array(POINTS_MM[p]) * 1e-3, 1.0])[:3] for p, w in asked])
    q = at_goals(truth, goals, 1)
    q = q + np.random.default_rng(2).normal(0.0, np.radians(0.05), q.shape)
    return [(angles, point, where) for angles, (point, where) in zip(q, asked, strict=True)]


@examples(10, 20)
@given(st.integers(0, 10_000), st.integers(1, 5))
def test_rigid_motion_is_found_whatever_is_touched(seed: int, count: int) -> None:
    """One point, points on a line, in a plane, in space: they arrive where they were seen, and lengths stay."""
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 0.1, (count, 3)) if seed % 2 else rng.normal(0, 0.1, (count, 1)) * rng.normal(0, 1, 3)
    T = placement_motion(Placement(*rng.normal(0, 0.3, 3), *rng.normal(0, 0.5, 3)))
    found = rigid_motion_between(points, points @ T[:3, :3].T + T[:3, 3], count > 1)
    assert np.abs(found.apply(points) - (points @ T[:3, :3].T + T[:3, 3])).max() < 1e-9
    assert np.allclose(found.rotation @ found.rotation.T, np.eye(3), atol=1e-9)


@pytest.mark.long
def test_touches_identify_the_arm_and_the_boards(so101: Arm, touches: Touches, tmp_path: Path) -> None:
    """Distances between tips that were never touched come out right: the scale is that of the board."""
    data = load_checked(write_touches(tmp_path, touches, points_toml()), so101)
    assert [frame.placement for frame in data.touched] == ["left", "right", "high"]
    study = Study.of(data, "offsets").fit()
    truth = model_of(so101, effects_at(so101, "offsets"), HIDDEN)
    fresh = poses_of(data.poses.q + np.random.default_rng(5).uniform(-0.15, 0.15, data.poses.q.shape))

    def missed(model: Model) -> float:
        tips, true = (solve_equilibrium(one, fresh).tcp for one in (model, truth))
        between = [np.linalg.norm(at[:, None] - at[None], axis=2) for at in (tips, true)]
        return float(np.sqrt(np.mean((between[0] - between[1]) ** 2)))

    drawn = missed(model_of(so101, ()))
    assert missed(as_deployed(study.taken.fit.model)) < 0.25 * drawn
    assert study.errors.held_out.error.rms < 1.5e-3 < study.nominal_error.rms
    assert not any("touched" in effect.id for effect in deployed_part(study.taken.fit.model).effects)


def test_distances_say_as_much_as_coordinates(so101: Arm, touches: Touches, tmp_path: Path) -> None:
    flat = [row for row in touches if row[1] != "D"]
    sides = {"A-B": 100.0, "B-C": 80.0, "A-C": float(np.hypot(100.0, 80.0))}
    table = "[distances]\n" + "\n".join(f"{key} = {value:.3f}" for key, value in sides.items())
    by_distance, by_place = (
        load_checked(write_touches(folder, flat, text), so101)
        for folder, text in ((tmp_path, table), (tmp_path, points_toml()))
    )
    assert np.abs(by_distance.tcp - by_place.tcp).max() < 5e-6


def test_measured_distances_adjust_nominal_places(touches: Touches, tmp_path: Path) -> None:
    """A print that shrank by 0.5 %: some measured distances say so of the board."""
    pairs = ("A-B", "B-C", "A-D", "A-C", "B-D")
    place = {name: np.array(at) for name, at in POINTS_MM.items()}
    lengths = {pair: 0.995 * float(np.linalg.norm(np.subtract(*(place[n] for n in pair.split("-"))))) for pair in pairs}
    table = points_toml() + "\n[distances]\n" + "\n".join(f"{pair} = {value:.3f}" for pair, value in lengths.items())
    path = write_touches(tmp_path, touches, table)
    metadata = metadata_of(path)
    assert metadata is not None
    found = known_points(path, metadata, {})
    for pair, length in lengths.items():
        a, b = (found[name] for name in pair.split("-"))
        assert abs(1e3 * float(np.linalg.norm(a - b)) - length) < 0.01


def test_without_distances_each_point_stands_alone(so101: Arm, touches: Touches, tmp_path: Path) -> None:
    data = load_checked(write_touches(tmp_path, touches, ""), so101)
    assert len(data.touched) == 12
    assert not any(frame.turns for frame in data.touched)
    assert any("scale of the arm is not measured" in notice for notice in data.source.notices)
    model = fit_model(nominal_model(so101, ["offsets"]), data, "identifiable", SQUARED).fit.model
    longest = max(range(1, 6), key=lambda k: max(abs(so101.joints[k - 1].a), abs(so101.joints[k - 1].d)))
    name = "a" if abs(so101.joints[longest - 1].a) > abs(so101.joints[longest - 1].d) else "d"
    assert abs(model.value(f"offsets.joint{longest}.{name}_mm")) < 1e-5


def test_folds_leave_touches_of_every_placement(so101: Arm, touches: Touches, tmp_path: Path) -> None:
    data = load_checked(write_touches(tmp_path, touches, points_toml()), so101)
    fold, placement = held_out_folds(data), data.poses.placement
    assert placement is not None
    for number in np.unique(fold):
        kept = placement[fold != number]
        assert np.bincount(kept, minlength=4)[1:].min() >= 6


def test_place_of_a_board_is_no_state_of_the_arm(so101: Arm, touches: Touches, tmp_path: Path) -> None:
    """A drift's state goes on to the arm; where the boards stood does not."""
    data = load_checked(write_touches(tmp_path, touches, points_toml()), so101)
    model = with_set_up(model_of(so101, [*effects_at(so101, "offsets"), *effects_at(so101, "drift@joint2")]), data)
    state = state_after_session(solve_equilibrium(model, data.poses))
    assert state == StateAfterSession({"drift@joint2": "last"}, {})


@pytest.mark.parametrize(
    ("beside", "change", "says"),
    [
        ("[points]\nA = [0, 0, 0]\nB = [100, 0, 0]\n[distances]\nA-B = 130", None, "130 mm, 100.0 mm by [points]"),
        ("[distances]\nA-B = 100\nA-C = 100", None, "the distance B-C is missing"),
        ("[distances]\nA-B = 100\nB-C = 80\nA-C = 300", None, "contradicts the other distances"),
        ("[distances]\nA-X = 100", None, "of no two touched points"),
        ("[points]\nA = [0, 0]", None, "at least 3"),
        ("[points]\nA = [0, 0, 0]", None, "line 3, column point: 'B' is not in [points]"),
        ("", (",A,", ",,"), "the cell is empty"),
        ("[points]\nA = [0, 0, 0]", ("point", "remark"), "no column point"),
        ('frame = "unknown"', None, "frames of their own"),
    ],
)
def test_bad_input_is_one_line(
    so101: Arm, touches: Touches, tmp_path: Path,
    beside: str, change: tuple[str, str] | None, says: str,
) -> None:  # fmt: skip
    path = write_touches(tmp_path, touches, beside)
    if change:
        path.write_text(path.read_text().replace(*change, 1))
    with pytest.raises(FileError) as caught:
        load_checked(path, so101)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_misread_joints_are_named(so101: Arm, touches: Touches, tmp_path: Path) -> None:
    other = [(q * [1, 1, -1, 1, 1], point, where) for q, point, where in touches]
    with pytest.raises(FileError, match="joint 3 looks counted the other way round"):
        load_checked(write_touches(tmp_path, other, points_toml()), so101)


def test_what_was_touched_once_is_left_out(so101: Arm, touches: Touches, tmp_path: Path) -> None:
    lone = [*touches, (touches[0][0], "A", "floor")]
    data = load_checked(write_touches(tmp_path, lone, points_toml()), so101)
    assert len(data.touched) == 3
    assert data.source.left_out == (25,)
    assert any("touched once" in notice for notice in data.source.notices)


def test_poses_elsewhere_know_no_board(so101: Arm) -> None:
    model = model_of(so101, effects_at(so101, "touched_board@placement1"), {"touched_board.placement1.x_mm": 0.1})
    poses: Poses = poses_of(np.zeros((1, 5)))
    settled = solve_equilibrium(model, poses)
    assert np.array_equal(settled.tcp, settled.true_tcp)
