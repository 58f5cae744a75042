"""The preliminary tests: one servo under load, the two targets against each other, the two-joint arm."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.special import stdtr

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.rigid_motion import rotation_matrix
from lrm_ident.data.servo_stiffness import GRAVITY, ServoTest, load_servo_test, stiffness
from lrm_ident.data.tracker_alignment import TrackerReadings, align, mean_quaternion, measurements_from
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.model_fit import nominal_model
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.errors import FileError, LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.conftest import ROOT
from tests.support.commands import stderr_of, stdout_of
from tests.support.sweep import examples
from validation import synthetic

EXAMPLES = ROOT / "lrm_ident" / "data" / "examples"
THERE_AND_BACK = np.array([0, 1, 2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0, 1, 2, 3, 2, 1, 0]) * 0.87
BACK = np.array([0, 0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1], dtype=bool)
NOISE = np.radians(0.06)


def servo(k: float, loop: float, cubic: float = 0.0, seed: int | None = None) -> ServoTest:
    """A servo with a spring (rad/N·m), a loop (rad), a cubic term (rad/(N·m)³), and noise if a seed is given."""
    angle = 0.01 + k * THERE_AND_BACK + cubic * THERE_AND_BACK**3 + np.where(BACK, loop / 2, -loop / 2)
    noise = 0.0 if seed is None else np.random.default_rng(seed).normal(0, NOISE, len(angle))
    return ServoTest(THERE_AND_BACK, angle + noise)


@given(k=st.floats(-0.2, 0.2), loop=st.floats(0.0, 0.05))
def test_spring_and_loop_are_read_exactly_without_noise(k: float, loop: float) -> None:
    found = stiffness(servo(k, loop))
    assert found.slope == pytest.approx(k, abs=1e-12)
    assert found.loop == pytest.approx(loop, abs=1e-12)
    assert found.offset == pytest.approx(0.01, abs=1e-12)
    np.testing.assert_array_equal(found.test.falling, BACK)
    np.testing.assert_allclose(found.secants, k, atol=1e-10)


def test_pulling_the_other_way_is_the_same_test() -> None:
    test = servo(0.03, 0.006, seed=1)
    mirrored = stiffness(ServoTest(-test.torque, -test.angle))
    found = stiffness(test)
    assert mirrored.slope == pytest.approx(found.slope)
    assert mirrored.loop == pytest.approx(found.loop)
    assert mirrored.scatter == pytest.approx(found.scatter)


def test_stated_errors_of_slope_and_loop_are_honest() -> None:
    found = [stiffness(servo(0.03, 0.006, seed=seed)) for seed in range(400)]
    slope = [abs(f.slope - 0.03) < 2.1 * f.slope_error for f in found]
    loop = [abs(f.loop - 0.006) < 2.1 * f.loop_error for f in found]  # type: ignore[operator]
    assert 0.92 < np.mean(slope) < 0.98
    assert 0.92 < np.mean(loop) < 0.98
    false_alarms = np.mean([f.curvature_p < 0.01 for f in found])  # type: ignore[operator]
    assert false_alarms < 0.03


def test_three_torques_are_tested_for_a_quadratic_term_alone() -> None:
    """Its F test is Student's test of that coefficient."""
    rng, torque = np.random.default_rng(4), np.tile([0.0, 1.0, 2.0, 1.0], 3)
    test = ServoTest(torque, 0.03 * torque + 0.002 * torque**2 + rng.normal(0.0, 0.002, 12))
    A = np.column_stack([np.ones(12), torque, np.where(test.falling, 0.5, -0.5), torque**2])
    estimate, squares, *_ = np.linalg.lstsq(A, test.angle, rcond=None)
    error = np.sqrt(squares[0] / 8 * np.linalg.inv(A.T @ A)[3, 3])
    assert stiffness(test).curvature_p == pytest.approx(2.0 * stdtr(8, -abs(estimate[3]) / error))


def test_a_spring_that_stiffens_is_noticed() -> None:
    found = stiffness(servo(0.03, 0.0, cubic=-0.001, seed=2))
    assert found.curvature_p < 0.01
    assert found.departure > 0.02


def test_without_unloading_no_loop_is_claimed() -> None:
    found = stiffness(ServoTest(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 0.031, 0.058, 0.091])))
    assert found.loop is None
    assert found.loop_error is None


@pytest.mark.parametrize("torque", [[1.0], [0.0, 1.0], [0.0, 1.0, 0.0, 1.0]])
def test_too_few_readings_are_refused(torque: list[float]) -> None:
    with pytest.raises(LrmError, match="at least 3 torques"):
        stiffness(ServoTest(np.array(torque), 0.03 * np.array(torque)))


def test_torque_from_load_and_lever(tmp_path: Path) -> None:
    path = tmp_path / "servo.csv"
    path.write_text("load_g,lever_mm,angle_deg\n0,200,0\n500,200,1\n1000,200,2\n")
    test = load_servo_test(path)
    np.testing.assert_allclose(test.torque, [0.0, 0.1 * GRAVITY, 0.2 * GRAVITY])
    path.write_text("load_g,angle_deg\n0,0\n")
    with pytest.raises(FileError, match="lever_mm"):
        load_servo_test(path)


@pytest.mark.slow
def test_the_shipped_example_is_read_within_its_errors(tmp_path: Path) -> None:
    truth = tomllib.loads((EXAMPLES / "one-servo.truth.toml").read_text())
    found = stiffness(load_servo_test(EXAMPLES / "one-servo.csv"))
    assert abs(found.slope - truth["k_rad_per_Nm"]) < 3 * found.slope_error
    assert abs(np.degrees(found.loop) - truth["loop_deg"]) < 3 * np.degrees(found.loop_error)  # type: ignore[arg-type]
    outputs = ("--json", tmp_path / "s.json", "--figure", tmp_path / "s.svg")
    said = stdout_of("stiffness", EXAMPLES / "one-servo.csv", *outputs)
    assert "play or friction" in said
    assert (tmp_path / "s.svg").stat().st_size > 1000


unit = st.floats(-1.0, 1.0)


@given(turn=st.tuples(unit, unit, unit, unit).filter(lambda q: np.linalg.norm(q) > 0.1), seed=st.integers(0, 1000))
def test_alignment_does_not_depend_on_where_the_tracker_stands(turn: tuple[float, ...], seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = np.array(turn) / np.linalg.norm(turn)
    R, place, known, deviation = rotation_matrix(q), rng.normal(0, 2, 3), rng.normal(0, 0.2, 3), rng.normal(0, 1e-3, 3)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    tcp = place + R @ (known + deviation)
    signs = rng.choice([-1.0, 1.0], (10, 1))
    found = align(TrackerReadings(np.tile(place, (10, 1)), signs * q, np.tile(tcp, (10, 1))), known)
    np.testing.assert_allclose(found.deviation, deviation, atol=1e-12)
    np.testing.assert_allclose(found.error, 0.0, atol=1e-12)


def test_quaternions_turn_as_they_should() -> None:
    half = np.sqrt(0.5)
    np.testing.assert_allclose(rotation_matrix(np.array([half, 0, 0, half])) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    mean = mean_quaternion(np.array([[1, 0.01, 0, 0], [-1, 0.01, 0, 0]]) / np.hypot(1, 0.01))
    np.testing.assert_allclose(np.abs(mean), [1, 0, 0, 0], atol=1e-12)


@pytest.mark.long
def test_stated_errors_of_the_alignment_are_honest() -> None:
    rng, inside = np.random.default_rng(0), []
    known, deviation = np.array([0.245, 0.0, 0.04]), np.array([-3e-4, -7e-4, 4e-4])
    for _ in range(120):
        q = np.array([1.0, 0, 0, 0]) + rng.normal(0, 3e-4, (40, 4))
        base = rng.normal(0, 1.5e-4, (40, 3))
        tcp = known + deviation + rng.normal(0, 2.5e-4, (40, 3))
        found = align(TrackerReadings(base, q / np.linalg.norm(q, axis=1)[:, None], tcp), known)
        inside.append(np.abs(found.deviation - deviation) < 2.02 * found.error)
    assert 0.91 < np.mean(inside) < 0.98


def test_raw_readings_become_measurements(tmp_path: Path, lab: Arm) -> None:
    rng = np.random.default_rng(1)
    q = rng.uniform(-1.5, 1.5, (30, 6))
    truth = solve_equilibrium(model_of(lab, ()), poses_of(q)).tcp
    turn = np.array([0.6, 0.0, 0.8, 0.0])
    deviation = np.array([-3.03e-4, -6.92e-4, 4.34e-4])
    tcp = (np.array([1.0, 2.0, 3.0]) + (truth + deviation) @ rotation_matrix(turn).T) * 1e3
    head = "pose,t_s," + ",".join(f"q{i + 1}_deg" for i in range(6))
    head += ",base_x_mm,base_y_mm,base_z_mm,base_qw,base_qx,base_qy,base_qz,tcp_x_mm,tcp_y_mm,tcp_z_mm"
    rows = [[i + 1, 15 * i, *np.degrees(q[i]), 1000, 2000, 3000, *turn, *tcp[i]] for i in range(30)]
    path = tmp_path / "raw.csv"
    path.write_text("\n".join([head, *(",".join(map(str, row)) for row in rows)]) + "\n")
    text, tracked = measurements_from(path, lab, deviation)
    (tmp_path / "data.csv").write_text(text)
    data = load_measurements(tmp_path / "data.csv", lab)
    np.testing.assert_allclose(data.tcp, truth, atol=1e-7)
    np.testing.assert_allclose(data.poses.q, q, atol=1e-8)
    assert tracked.base_scatter() == 0.0
    path.write_text(path.read_text().replace("0.6,0.0,0.8", "0.6,0.0,0.9"))
    with pytest.raises(FileError, match="quaternion"):
        measurements_from(path, lab, deviation)


def test_align_is_a_command(tmp_path: Path) -> None:
    fixture = EXAMPLES / "fixture.csv"
    said = stdout_of("align", fixture, "--known-mm", "245,0,40", "--json", tmp_path / "a.json")
    assert "noise_sd_mm" in said
    for words in (["--known-mm", "245,0"], ["--known-mm", "245,0,nan"], ["--known-mm", "1,2,3", "--raw", "x.csv"]):
        assert stderr_of("align", fixture, *words)


@pytest.mark.slow
@examples(2, 5)
@example(seed=71)
@given(seed=st.integers(0, 1000))
def test_the_method_is_rehearsed_on_two_joints(seed: int) -> None:
    arm = load_arm("two-joint")
    rig = synthetic.load_arm(shipped_arms()["two-joint"])
    levels = np.radians(np.linspace(-100, 100, 10))
    q = np.stack(np.meshgrid(levels, levels, indexing="ij"), axis=-1).reshape(-1, 2)
    rng = np.random.default_rng(seed)
    off = {"joint2.theta_rad": rng.normal(0, 0.02), "base.z_m": rng.normal(0, 0.003), "tool.z_m": rng.normal(0, 0.002)}
    truth = replace(
        synthetic.GroundTruth.nominal(rig),
        deviations=synthetic.Deviations.named(2, off),
        base_compliance_rad_per_nm=0.02,
        joint_compliance_rad_per_nm=(0.08, 0.06),
    )
    tcp = synthetic.measure(rig, truth, q, 0.0, 3e-4, seed)
    data = Measurements.of_tcp(poses_of(q), tcp, 3e-4)
    model = nominal_model(arm)
    found = fit_identifiable(model, data, model.keys).fit
    drawn, n, p = synthetic.measure(rig, truth, q) - tcp, tcp.size, len(model.keys)
    spread = np.sqrt(p / (2 * n * (n - p)))  # of sigma about that of the noise drawn, of which the fit takes up p parts
    assert found.sigma == pytest.approx(np.sqrt((drawn**2).mean()), rel=5 * spread)
    elsewhere = synthetic.random_poses(rig, 200, seed + 1)
    missed = synthetic.measure(rig, truth, elsewhere) - solve_equilibrium(found.model, poses_of(elsewhere)).tcp
    assert np.sqrt((missed**2).mean()) < 3e-4 * np.sqrt(p / n) * (1 + 5 / np.sqrt(2 * p))  # half of one reading's noise
