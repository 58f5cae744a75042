"""Is the question right? Misreadings are said with the option that accepts them; healthy data are never refused."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import lrm_ident as lrm
from lrm_ident.data.measurement_file.conventions import (
    axes_matrix,
    axes_words,
    frame_table,
    read_joints,
    read_positions,
    rigid_motion,
)
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.checked import Misread, load_checked
from lrm_ident.data.registration.degenerate_fit import DegenerateFit, check_arm
from lrm_ident.data.registration.point_set import nominal_tcp, registered
from lrm_ident.data.registration.reading_check import check_reading
from lrm_ident.data.registration.similarity import robust_similarity, similarity
from lrm_ident.data.source import Source
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.reading import Reading, parse_axes
from tests.conftest import EXAMPLE, SHARED
from tests.support.commands import stderr_of, stdout_of
from tests.support.misreadings import ARMS, HEALTHY, KINDS, healthy_data, misread, random_arm_data
from tests.support.sweep import examples, seeds, soak

pytestmark = pytest.mark.long

TWO_JOINTS = SHARED / "data" / "lrm-two-joint" / "measurements.csv"
OPTION_1 = ["--parameters", "option1"]


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(KINDS)))
def test_each_misreading_is_understood_on_one_arm(number: int) -> None:
    case = misread(ARMS[number % len(ARMS)], KINDS[number], seed=7)
    assert case.understood(check_reading(case.arm, case.data))


@pytest.mark.slow
@pytest.mark.parametrize("name", HEALTHY)
def test_a_bad_arm_is_not_refused(name: str) -> None:
    for seed in seeds(1, 3):
        check = check_reading(load_arm(name), healthy_data(name, seed))
        assert check is None or check.right


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "number", "slipped"), [(ARMS[0], 1, True), *soak(*product(ARMS, range(3), (False, True)))]
)
@pytest.mark.parametrize("seed", seeds(1, 3))
def test_what_moved_meanwhile_is_no_misreading(seed: int, name: str, number: int, slipped: bool) -> None:
    """A base that was pushed along an axis by a fifth of the spread, or a joint whose horn slipped by 20 deg."""
    data, arm = random_arm_data(name, seed), load_arm(name)
    later = np.arange(len(data)) >= len(data) // 2
    tcp, q = data.tcp.copy(), data.poses.q.copy()
    if slipped:
        q[later, number] += np.radians(20.0)
    else:
        tcp[later, number] += 0.2 * np.sqrt(tcp.var(axis=0).sum())
    check = check_reading(arm, replace(data, poses=replace(data.poses, q=q)).with_tcp(tcp))
    assert not any("belong" in words for scored in check.found for words in scored.hypothesis.words)


def test_a_base_that_was_pushed_is_said_in_a_notice(tmp_path: Path) -> None:
    data = random_arm_data("lrm-lab", 5)
    tcp = data.tcp.copy()
    tcp[len(tcp) // 2 :, 2] += 0.06  # m
    path = tmp_path / "pushed.csv"
    path.write_text(measurements_csv(data.with_tcp(tcp)), encoding="utf-8")
    (notice,) = load_checked(path, load_arm("lrm-lab")).source.notices
    assert "did its base or the tracker move?" in notice


@pytest.mark.parametrize(
    ("arm", "path", "reading"),
    [
        ("lrm-lab", "lrm-lab-no-load/measurements.csv", Reading()),
        ("ur5", "ur5/grid.csv", Reading()),
        ("two-joint", "lrm-two-joint/measurements.csv", Reading(axes="-x,-y,z")),
    ],
)
def test_real_measurements_are_not_refused(arm: str, path: str, reading: Reading) -> None:
    data = SHARED / "data" / path
    if not data.exists():
        pytest.skip("the real measurements are not here")
    assert load_checked(data, load_arm(arm), reading).source.notices == ()


def test_the_real_two_joint_data_are_turned_by_half_a_turn() -> None:
    if not TWO_JOINTS.exists():
        pytest.skip("the real measurements are not here")
    with pytest.raises(Misread, match="--axes=-x,-y,z"):
        load_checked(TWO_JOINTS, load_arm("two-joint"))


@pytest.mark.slow
def test_both_spellings_of_the_real_two_joint_data_end_in_one_model(tmp_path: Path) -> None:
    if not TWO_JOINTS.exists():
        pytest.skip("the real measurements are not here")
    arm = load_arm("two-joint")
    raw = load_checked(TWO_JOINTS, arm, Reading(axes="-x,-y,z"))
    negated = load_checked(_written(tmp_path, raw), arm)
    one, other = (lrm.fit(data).model for data in (raw, negated))
    assert one.free == other.free
    np.testing.assert_allclose(one.values, other.values, atol=1e-9)


def _written(folder: Path, data: Measurements, name: str = "data.csv") -> Path:
    path = folder / name
    path.write_text(measurements_csv(data))
    return path


def _fitted(path: Path, model: Path, *options: str) -> dict[str, float]:
    stdout_of("fit", path, "--arm", "lrm-lab", *OPTION_1, *options, "-o", model)
    found: dict[str, float] = tomllib.loads(model.read_text())["parameters"]
    return found


@pytest.fixture(scope="module")
def healthy() -> Measurements:
    return random_arm_data("lrm-lab", 3, poses=60)


MISTAKES = {
    "--axes x,y,-z": (Reading(axes="x,y,-z"), lambda q, tcp: (q, tcp * [1, 1, -1])),
    "--unit m": (Reading(unit="m"), lambda q, tcp: (q, tcp * 1e-3)),
    "--angle-unit rad": (Reading(angle_unit="rad"), lambda q, tcp: (np.radians(q), tcp)),
    "--joint-order 1,3,2,4,5,6": (
        Reading(joint_order=[1, 3, 2, 4, 5, 6]),
        lambda q, tcp: (q[:, [0, 2, 1, 3, 4, 5]], tcp),
    ),
    "--joint-sign 1,1,1,-1,1,1": (
        Reading(joint_sign=[1, 1, 1, -1, 1, 1]),
        lambda q, tcp: (q * [1, 1, 1, -1, 1, 1], tcp),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("option", MISTAKES)
def test_the_option_that_is_named_mends_the_reading(tmp_path: Path, healthy: Measurements, option: str) -> None:
    reading, mistake = MISTAKES[option]
    q, tcp = mistake(healthy.poses.q, healthy.tcp)
    path = _written(tmp_path, replace(healthy, poses=replace(healthy.poses, q=q)).with_tcp(tcp))
    with pytest.raises(Misread, match=option):
        load_checked(path, load_arm("lrm-lab"))
    mended = load_checked(path, load_arm("lrm-lab"), reading)
    np.testing.assert_allclose(mended.tcp, healthy.tcp, atol=1e-6)
    np.testing.assert_allclose(mended.poses.q, healthy.poses.q, atol=1e-8)


def _shares(q_deg: Array) -> Array:
    """LeRobot's -100 to 100, of ranges that a hand swept, a few degrees beyond the limits drawn."""
    swept = np.array([226.0, 205.0, 197.0, 199.0, 330.0])
    return q_deg / (swept / 2.0) * 100.0


@pytest.mark.parametrize(
    ("recorded", "said"),
    [
        (lambda q_deg: np.round(q_deg * 4096.0 / 360.0) + 2048.0, r"encoders; .*\(count - 2048\) \* 360 / 4096"),
        (_shares, "LeRobot's -100 to 100 of each joint's range; if so: record with use_degrees=true"),
    ],
)
@pytest.mark.parametrize("seed", [1, *soak(2, 3)])
def test_lerobot_units_are_no_degrees(tmp_path: Path, recorded: Callable[[Array], Array], said: str, seed: int) -> None:
    own = random_arm_data("so101", seed, poses=60)
    q = np.radians(recorded(np.degrees(own.poses.q)))
    path = _written(tmp_path, replace(own, poses=replace(own.poses, q=q)))
    with pytest.raises(Misread, match=said):
        load_checked(path, load_arm("so101"))


@pytest.mark.slow
def test_the_model_remembers_how_its_data_were_read(tmp_path: Path, healthy: Measurements) -> None:
    path, model = _written(tmp_path, healthy.with_tcp(healthy.tcp[:, [1, 0, 2]])), tmp_path / "model.toml"
    _fitted(path, model, "--axes", "y,x,z")
    assert tomllib.loads(model.read_text())["provenance"]["reading"] == {"axes": "y,x,z"}
    stdout_of("compare", model, path)
    right = _written(tmp_path, healthy, "right.csv")
    assert "--axes x,y,z" in stderr_of("compare", model, right)
    assert "--axes x,y,z" in stderr_of("diagnose", model, right)


def test_the_file_beside_the_data_says_how_to_read_them(tmp_path: Path, healthy: Measurements) -> None:
    path = _written(tmp_path, healthy.with_tcp(healthy.tcp * [1e-3, 1e-3, -1e-3]))
    path.with_suffix(".toml").write_text('schema = "lrm/measurements/1"\nunit = "m"\naxes = "x,y,-z"\n')
    np.testing.assert_allclose(load_checked(path, load_arm("lrm-lab")).tcp, healthy.tcp, atol=1e-6)


@pytest.mark.slow
def test_an_unknown_frame_is_found_with_the_fit(tmp_path: Path, healthy: Measurements) -> None:
    rotation, translation = _motion(5)
    path = _written(tmp_path, healthy.with_tcp((healthy.tcp - translation) @ rotation))
    assert "--frame unknown" in stderr_of("fit", path, "--arm", "lrm-lab", *OPTION_1)
    right, found = tmp_path / "right.toml", tmp_path / "found.toml"
    _fitted(_written(tmp_path, healthy, "right.csv"), right)
    _fitted(path, found, "--frame", "unknown")
    errors = [tomllib.loads(model.read_text())["history"][0]["fit_rms_mm"] for model in (right, found)]
    assert errors[1] < 1.2 * errors[0]


@pytest.mark.parametrize(
    ("arm_name", "mistake"),
    [
        ("lrm-lab", "--joint-sign"),
        ("so101", "--joint-order"),
        *soak(("so101", "--joint-sign"), ("lrm-lab", "--joint-order")),
    ],
)
def test_radians_of_another_convention_in_metres_of_another_frame(tmp_path: Path, arm_name: str, mistake: str) -> None:
    """All that another program does its own way at once: every mistake is said, and the options read it."""
    own, (rotation, translation) = random_arm_data(arm_name, 3, poses=80), _motion(5)
    q = own.poses.q.copy()
    q[:, [1, 2]] = q[:, [1, 2]] * [1.0, -1.0] if mistake == "--joint-sign" else q[:, [2, 1]]
    q, tcp = np.radians(q), 1e-3 * (own.tcp - translation) @ rotation
    path = _written(tmp_path, replace(own, poses=replace(own.poses, q=q)).with_tcp(tcp))
    with pytest.raises(Misread) as refused:
        load_checked(path, load_arm(arm_name))
    numbers = ",".join(map(str, range(4, own.poses.q.shape[1] + 1)))
    words = f"1,1,-1,{','.join('1' for _ in numbers.split(','))}" if mistake == "--joint-sign" else f"1,3,2,{numbers}"
    for said in ("--unit m", "--angle-unit rad", f"{mistake} {words}", "--frame unknown"):
        assert said in str(refused.value)


def test_radians_as_degrees_that_no_arm_can_have_are_one_clear_line(tmp_path: Path) -> None:
    """Nothing explains a strange order of joints beside two units, and no arm is tried that would not settle."""
    own = random_arm_data("lrm-lab", 3, poses=80)
    q = np.radians(own.poses.q[:, [4, 2, 0, 3, 1, 5]])
    path = _written(tmp_path, replace(own, poses=replace(own.poses, q=q)).with_tcp(1e-3 * own.tcp))
    with pytest.raises(Misread):
        load_checked(path, load_arm("lrm-lab"))


@pytest.mark.parametrize("arm_name", ["lrm-lab", "so101"])
@pytest.mark.parametrize("reflector_mm", [0.0, 100.0, *soak(60.0)])
def test_an_unknown_frame_stands_at_the_base_however_the_arm_sags(arm_name: str, reflector_mm: float) -> None:
    """A frame found from a sagging arm: all tips lie lower, and none of it is taken for a place of the base.

    Nor is a reflector on the flange. Before: of 130 mm up to 15 mm were taken for the base.
    """
    arm = load_arm(arm_name)
    effects = (*effects_at(arm, "offsets"), *effects_at(arm, "compliance"))
    values = {"compliance.joint2.k_rad_per_Nm": 0.08, "compliance.joint3.k_rad_per_Nm": 0.08}
    values |= {"offsets.joint3.theta_rad": 0.03, "offsets.joint4.theta_rad": -0.02}
    values |= {"offsets.tool.x_mm": 1e-3 * reflector_mm}
    ranges = np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    poses = poses_of(np.random.default_rng(6).uniform(*0.7 * ranges, (100, arm.dof)))
    true = solve_equilibrium(model_of(arm, effects, values), poses).tcp
    rotation, translation = _motion(5)
    found = registered(arm, poses, (true - translation) @ rotation)[0]
    moved = similarity(true, found, np.ones(len(true)), mirrored=False, scale=1.0)
    assert np.abs(moved.translation).max() < 1e-4
    assert np.abs(moved.rotation - np.eye(3)).max() < 1e-4


@pytest.mark.parametrize(("fitted_in", "said"), [("another", "--frame arm"), ("the arm's", "--frame unknown")])
@pytest.mark.parametrize("arm_name", ["lrm-lab", *soak("so101")])
def test_data_in_another_frame_than_those_of_the_fit(tmp_path: Path, arm_name: str, fitted_in: str, said: str) -> None:
    """A model's reading counts for the next data; where only their frame differs, no joint is called wrong."""
    arm, (rotation, translation) = load_arm(arm_name), _motion(5)
    own = random_arm_data(arm_name, 3, poses=60)
    other = own.with_tcp((own.tcp - translation) @ rotation)
    frame = frame_table(rotation, translation) if fitted_in == "another" else "arm"
    path = _written(tmp_path, own if fitted_in == "another" else other)
    with pytest.raises(Misread) as refused:
        load_checked(path, arm, usual=Reading(frame=frame))
    assert f"if so: {said} (then" in str(refused.value)
    assert "joint" not in str(refused.value)
    mended = load_checked(path, arm, Reading(frame="arm" if said == "--frame arm" else "unknown"), Reading(frame=frame))
    if said == "--frame arm":
        np.testing.assert_allclose(mended.tcp, own.tcp, atol=1e-6)
    else:
        left = similarity(mended.tcp, own.tcp, np.ones(60), mirrored=False, scale=1.0).apply(mended.tcp) - own.tcp
        assert np.abs(left).max() < 1e-6


def test_a_frame_that_is_known_is_stated_beside_the_data(tmp_path: Path) -> None:
    """The table of docs/files.md: Rx Ry Rz and the shift take a measured position into the arm's frame."""
    own, shift = random_arm_data("lrm-lab", 3, poses=20), np.array([0.4, -1.2, 0.7])
    turn = Rotation.from_euler("XYZ", [90.0, 53.0, -20.0], degrees=True).as_matrix()
    path = _written(tmp_path, own.with_tcp((own.tcp - shift) @ turn))
    stated = "frame = {x_mm = 400, y_mm = -1200, z_mm = 700, alpha_deg = 90, beta_deg = 53, gamma_deg = -20}\n"
    path.with_suffix(".toml").write_text(f'schema = "lrm/measurements/1"\n{stated}')
    np.testing.assert_allclose(load_measurements(path, load_arm("lrm-lab")).tcp, own.tcp, atol=1e-6)


def test_limits_are_checked_after_the_question(tmp_path: Path) -> None:
    data = random_arm_data("so101", 3, poses=60)
    data.poses.q[:2, 4] = np.radians(160.0)
    data = data.with_tcp(nominal_tcp(load_arm("so101"), data.poses))
    flipped = _written(tmp_path, replace(data, poses=replace(data.poses, q=data.poses.q * [1, -1, 1, 1, -1])))
    assert "counted the other way" in stderr_of("fit", flipped, "--arm", "so101")
    beyond = data.poses.q.copy()
    beyond[3, 1] = np.radians(130.0)
    said = stderr_of("fit", _written(tmp_path, replace(data, poses=replace(data.poses, q=beyond))), "--arm", "so101")
    assert "beyond the limits of joint 2" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--axes", "x,y"], "each once"),
        (["--unit", "km"], "'mm'"),
        (["--joint-sign", "1,2,1,1,1,1"], "1 or -1"),
        (["--joint-sign", "1,1"], "lrm-lab has 6"),
        (["--joint-order", "1,1,2,3,4,5"], "once"),
        (["--joint-order", "a"], "whole numbers"),
        (["--frame", "there"], "unknown"),
    ],
)
def test_readings_that_mean_nothing(words: list[str], said: str) -> None:
    assert said in stderr_of("fit", EXAMPLE, "--arm", "lrm-lab", *words)


def _drawn_with(values: dict[str, float]) -> Equilibrium:
    arm = load_arm("lrm-lab")
    poses = poses_of(np.random.default_rng(0).uniform(-1, 1, (60, 6)))
    return solve_equilibrium(model_of(arm, effects_at(arm, "offsets"), values), poses)


def _refusal_or_verdict(looking: Callable[[Model, Measurements], Any], model: Model, data: Measurements) -> str:
    try:
        return str(looking(model, data).verdict)
    except DegenerateFit:
        return "refused"


@pytest.mark.parametrize(
    ("values", "said", "with_typical_sizes"),
    [
        ({"offsets.joint2.extra_z_mm": -0.100}, "collapse", "refused"),
        ({f"offsets.{key}_mm": -0.06 for key in ("joint2.extra_z", "joint4.extra_z", "tool.z")}, "shrinks", "refused"),
        (
            {f"offsets.{key}_mm": 0.09 for key in ("joint2.extra_z", "joint4.extra_z", "tool.z")},
            "stretches",
            "unexplained_structure",
        ),
    ],
)
def test_whatever_fits_refuses_to_destroy_the_arm(values: dict[str, float], said: str, with_typical_sizes: str) -> None:
    destroyed = _drawn_with(values)
    drawn = model_of(destroyed.model.arm, destroyed.model.effects)
    number = np.arange(60)
    data = Measurements.of_tcp(destroyed.poses, destroyed.tcp, 1e-4, pose=number, source=Source(arm=drawn.arm))
    keys = tuple(key for key in drawn.keys if key.endswith(("extra_z_mm", "tool.z_mm")))
    model = replace(drawn, free=keys)
    for fitting in (
        lambda: lrm.fit(data, effects=["offsets"], parameters=",".join(keys)),
        lambda: lrm.add(model, data, "compliance"),
    ):
        with pytest.raises(DegenerateFit, match=said):
            fitting()
    assert _refusal_or_verdict(lrm.diagnose, model, data) == with_typical_sizes
    with_all_lengths = "refused" if said == "shrinks" else "unexplained_structure"
    assert _refusal_or_verdict(lrm.auto, model, data) == with_all_lengths
    check_arm(_drawn_with({}), keys)


def test_a_length_that_others_undo_does_not_collapse() -> None:
    """The first joint's offset along its axis and the base's position: together they move nothing."""
    equilibrium = _drawn_with({"offsets.joint1.d_mm": -0.080})
    keys = [key for key in equilibrium.model.keys if "base" in key or key == "offsets.joint1.d_mm"]
    check_arm(equilibrium, keys)
    with pytest.raises(DegenerateFit, match="collapse"):
        check_arm(equilibrium, ["offsets.joint1.d_mm"])


def test_a_fit_that_no_parameter_helps_is_refused() -> None:
    data = replace(random_arm_data("lrm-lab", 3, poses=60), source=Source(arm=load_arm("lrm-lab")))
    far = data.with_tcp(np.random.default_rng(0).normal(0.0, 10.0, data.tcp.shape))
    with pytest.raises(LrmError, match="nothing can be fitted"):
        lrm.fit(far, effects=["compliance"])


def _motion(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return Q * np.sign(np.linalg.det(Q)), rng.normal(0.0, 0.5, 3)


@given(st.integers(0, 10_000))
def test_frames_survive_their_table(seed: int) -> None:
    rotation, translation = _motion(seed)
    found, moved = rigid_motion(frame_table(rotation, translation))
    np.testing.assert_allclose(found, rotation, atol=1e-12)
    np.testing.assert_allclose(moved, translation, atol=1e-12)


@given(st.integers(0, 10_000), st.floats(1e-3, 1e3), st.booleans())
def test_similarity_is_recovered_beside_wrong_points(seed: int, scale: float, mirrored: bool) -> None:
    rng, (rotation, translation) = np.random.default_rng(seed), _motion(seed)
    turn = rotation * [1.0, 1.0, -1.0] if mirrored else rotation
    points = rng.normal(0.0, 0.2, (50, 3))
    images = scale * points @ turn.T + translation
    images[:3] += scale * rng.normal(0.0, 1.0, (3, 3))
    found = robust_similarity(points, images, mirrored)
    np.testing.assert_allclose(found.rotation, turn, atol=0.05)
    assert found.scale == pytest.approx(scale, rel=0.05)


@given(st.permutations(range(3)), st.tuples(*[st.booleans()] * 3))
def test_axes_are_words_and_matrices(order: list[int], minus: tuple[bool, ...]) -> None:
    words = ",".join(("-" if sign else "") + "xyz"[axis] for axis, sign in zip(order, minus, strict=True))
    assert parse_axes(words) == axes_words(axes_matrix(words)) == words
    points = np.random.default_rng(0).normal(size=(4, 3))
    expected = np.stack(
        [points[:, axis] * (-1 if sign else 1) for axis, sign in zip(order, minus, strict=True)], axis=1
    )
    np.testing.assert_array_equal(read_positions(Reading(axes=words), points), expected)


@examples(10, 20)
@given(st.permutations(range(1, 7)), st.lists(st.sampled_from([1, -1]), min_size=6, max_size=6))
def test_joints_are_reordered_then_signed(order: list[int], sign: list[int]) -> None:
    columns = np.arange(1.0, 7.0)
    read = read_joints(Reading(joint_order=order, joint_sign=sign), columns)
    assert read.tolist() == [s * columns[k - 1] for k, s in zip(order, sign, strict=True)]


def test_what_is_said_first_counts() -> None:
    first, second = Reading(axes="x,y,-z"), Reading(axes="y,x,z", unit="m")
    assert first.over(second) == Reading(axes="x,y,-z", unit="m")
    for one, other in pairwise([Reading(), first, second]):
        assert one.over(other).over(None) == one.over(other)


def test_noise_is_not_scaled_away(tmp_path: Path) -> None:
    """Reading in metres by the column's name or by the option is the same."""
    data = random_arm_data("lrm-lab", 4, poses=20)
    text = measurements_csv(data.with_tcp(data.tcp * 1e-3))
    plain, named = tmp_path / "plain.csv", tmp_path / "named.csv"
    plain.write_text(text)
    named.write_text(text.replace("x_mm,y_mm,z_mm", "x_m,y_m,z_m"))
    arm = load_arm("lrm-lab")
    by_option, by_name = load_measurements(plain, arm, Reading(unit="m")), load_measurements(named, arm)
    np.testing.assert_array_equal(by_option.tcp, by_name.tcp)
