"""The synthetic generator on its own: laws of mechanics, motion, noise, files."""

from __future__ import annotations

import csv
import math
import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.conftest import ROOT
from tests.support.sweep import examples
from validation import synthetic
from validation.synthetic import (
    ArmDescription,
    Deviations,
    GroundTruth,
    HiddenEffect,
    LinkBending,
    SoftPlay,
    measure,
    random_poses,
    true_state,
)
from validation.synthetic.chain import Posture, forward_kinematics, zero_configuration
from validation.synthetic.hidden_effect import CommandedPoses, EndLoad, JointLoad
from validation.synthetic.screws import Array, displacement, exponential, revolute_twist, rotation_matrix
from validation.synthetic.statics import newton

EXAMPLES = ROOT / "lrm_ident" / "data" / "examples"
REFERENCE = ROOT.parent / "shared" / "data" / "reference"
NM_PER_NMM = 1e-3

vectors = st.tuples(*[st.floats(-4.0, 4.0)] * 3)


@pytest.fixture(scope="module")
def arm() -> ArmDescription:
    return synthetic.load_arm(ROOT / "config" / "arms" / "lrm-lab.toml")


@pytest.fixture(scope="module")
def lawful(arm: ArmDescription) -> ArmDescription:
    """The same arm, but every body moves with the joint that counts it: only then does gravity have an energy."""
    tool = len(arm.links) + 1
    return replace(
        arm,
        bodies=tuple(b if b.frame == tool else replace(b, frame=b.loads_joint, near_end=False) for b in arm.bodies),
    )


@given(turn=vectors)
def test_rotations_are_orthonormal(turn: tuple[float, float, float]) -> None:
    R = rotation_matrix(turn)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-13)
    assert np.linalg.det(R) == pytest.approx(1.0)


@given(axis=vectors.filter(lambda v: math.hypot(*v) > 0.1), point=vectors, angle=st.floats(-7.0, 7.0))
def test_screw_turns_about_its_line(
    axis: tuple[float, float, float], point: tuple[float, float, float], angle: float
) -> None:
    unit = np.array(axis) / math.hypot(*axis)
    screw = exponential(revolute_twist(unit, np.array(point)), np.array(angle))
    turn = displacement(np.array(point), unit * angle, np.zeros(3))
    np.testing.assert_allclose(screw.rotation, turn.rotation, atol=1e-12)
    np.testing.assert_allclose(screw.translation, turn.translation, atol=1e-12)
    np.testing.assert_allclose(screw.point(np.array(point) + unit), np.array(point) + unit, atol=1e-12)


def test_zero_configuration_of_the_lab_rig(arm: ArmDescription) -> None:
    """Stretched out, all lengths lie on one line, which leans forward by 60 deg."""
    tcp = true_state(arm, GroundTruth.nominal(arm), np.zeros((1, 6))).tcp_m[0]
    reach = 46.905 + 103.505 + 43.06953 + 107.75 + 43.25 + 73.27
    lean = np.array([math.sin(math.pi / 3), 0.0, math.cos(math.pi / 3)])
    np.testing.assert_allclose(tcp * 1000.0, np.array([45.98, 0.0, 82.012391]) + reach * lean, atol=1e-9)


def test_deflections_are_those_of_their_loads(arm: ArmDescription) -> None:
    truth = GroundTruth.random(arm, 1)
    q = random_poses(arm, 40, 2)
    state = true_state(arm, truth, q, 0.05)
    soft = np.array(truth.joint_compliance_rad_per_nm)
    np.testing.assert_allclose(state.joints_rad, soft * state.tau_nm, atol=1e-12)
    np.testing.assert_allclose(state.base_rad, truth.base_compliance_rad_per_nm * state.base_moment_nm, atol=1e-12)
    stiff = replace(truth, base_compliance_rad_per_nm=0.0, joint_compliance_rad_per_nm=(0.0,) * 6)
    leaning = _leaning(arm, stiff, float(state.base_rad[0]))
    there = true_state(arm, leaning, q[:1] + state.joints_rad[:1], 0.05)
    np.testing.assert_allclose(there.tcp_m, state.tcp_m[:1], atol=1e-12)
    np.testing.assert_allclose(there.tau_nm, state.tau_nm[:1], atol=1e-12)


def _leaning(arm: ArmDescription, truth: GroundTruth, angle_rad: float) -> GroundTruth:
    """A rigid arm whose base is mounted with the given deflection about its own y axis."""
    axes = zero_configuration(arm, truth).ends[0].axes
    tilt = rotation_matrix(axes[:, 1] * angle_rad)
    # the slips are in world axes, so those of links and tool turn with the base
    slips = [np.concatenate([tilt @ slip[:3], tilt @ slip[3:]]) for slip in np.array(truth.displacements)]
    mounted = Rotation.from_matrix(tilt @ rotation_matrix(truth.displacements[0][:3])).as_rotvec()
    slips[0] = np.concatenate([mounted, truth.displacements[0][3:]])
    return replace(truth, displacements=tuple(_six(slip) for slip in slips))


def _six(values: Array) -> tuple[float, float, float, float, float, float]:
    a, b, c, d, e, f = values.tolist()
    return a, b, c, d, e, f


def test_newton_agrees_with_scipy() -> None:
    def residual(u: Array) -> Array:
        x, y = u[:, 0], u[:, 1]
        return np.stack([x - np.cos(y), y + np.tanh(3.0 * x) - 1.0], axis=1)

    def single(u: Array) -> Array:
        return np.asarray(residual(u[None])[0])

    roots = newton(residual, np.zeros((5, 2)))
    reference = scipy.optimize.root(single, np.zeros(2), tol=1e-13).x
    np.testing.assert_allclose(roots, np.tile(reference, (5, 1)), atol=1e-11)


def test_no_compliance_is_rigid(arm: ArmDescription) -> None:
    q = random_poses(arm, 10, 3)
    state = true_state(arm, GroundTruth.nominal(arm), q, 0.2)
    rigid = forward_kinematics(zero_configuration(arm, GroundTruth.nominal(arm)), np.zeros(10), q, {})
    np.testing.assert_array_equal(state.tcp_m, rigid.tcp)
    assert not state.joints_rad.any()


def test_bodies_keep_their_distances(arm: ArmDescription) -> None:
    """Bodies of one frame move together, whatever the posture."""
    state = true_state(arm, GroundTruth.random(arm, 4), random_poses(arm, 20, 5))
    names = [body.name for body in arm.bodies]
    for first, second in [("link 2", "link 3"), ("link 4", "link 5"), ("link 6", "target")]:
        gap = state.posture.centres[:, names.index(first)] - state.posture.centres[:, names.index(second)]
        np.testing.assert_allclose(np.linalg.norm(gap, axis=1), np.linalg.norm(gap[0]), rtol=1e-12)


def test_moments_are_slopes_of_the_potential_energy(lawful: ArmDescription) -> None:
    truth = GroundTruth.random(lawful, 6)
    q = random_poses(lawful, 20, 7)
    state = true_state(lawful, truth, q)
    chain = zero_configuration(lawful, truth)
    masses = np.array([body.mass_kg for body in lawful.bodies])

    def energy(shift: Array) -> Array:
        posture = forward_kinematics(chain, state.base_rad + shift[0], q + state.joints_rad + shift[1:], {})
        return _height_energy(lawful, masses, posture)

    slopes = _slopes(energy, 7)
    np.testing.assert_allclose(state.tau_nm, -slopes[:, 1:], atol=1e-8)
    np.testing.assert_allclose(state.base_moment_nm, -slopes[:, 0], atol=1e-8)


def test_bending_equilibrium_has_the_least_energy(lawful: ArmDescription) -> None:
    """Springs, beam and gravity together: no small change of the beam's end lowers the energy."""
    length = 0.1
    truth = replace(GroundTruth.random(lawful, 8), effects=(LinkBending(2, length, (600.0, 1500.0)),))
    q = random_poses(lawful, 10, 9)
    state = true_state(lawful, truth, q, 0.1)
    chain = zero_configuration(lawful, truth)
    masses = np.array([b.mass_kg + 0.1 * b.carries_payload for b in lawful.bodies])
    beam = truth.effects[0]
    assert isinstance(beam, LinkBending)
    bend = beam.link_deflection(_end_load(lawful, state.posture, masses, q))

    def energy(shift: Array) -> Array:
        now = bend + shift
        posture = forward_kinematics(chain, state.base_rad, q + state.joints_rad, {2: now})
        gravity = _height_energy(lawful, masses, posture)
        planes = [(now[:, 0], -now[:, 4], 600.0), (now[:, 1], now[:, 3], 1500.0)]
        strain = [_strain_energy(w, t, length, rigidity) for t, w, rigidity in planes]
        return gravity + strain[0] + strain[1]

    # along the beam and about it the link is rigid; that a rotation vector is no angle about fixed axes shows at 1e-5
    np.testing.assert_allclose(_slopes(energy, 6)[:, [0, 1, 3, 4]], 0.0, atol=4e-5)

    def height(shift: Array) -> Array:
        posture = forward_kinematics(chain, state.base_rad, q + state.joints_rad, {2: bend + shift})
        return _height_energy(lawful, masses, posture)

    assert np.abs(_slopes(height, 6)[:, :2]).max() > 0.1


def _strain_energy(deflection: Array, turn: Array, length: float, rigidity: float) -> Array:
    """Strain energy of a cantilever whose end is shifted and turned (its stiffness matrix is textbook knowledge)."""
    w, t = deflection / length, turn
    return 2.0 * rigidity / length * (3.0 * w**2 - 3.0 * w * t + t**2)


def _end_load(arm: ArmDescription, posture: Posture, masses: Array, q: Array) -> EndLoad:
    now = CommandedPoses(arm, q, q, q[:, 0], q[:, 0], q[:, 0])
    weights = masses[:, None] * np.array(arm.gravity_m_per_s2)
    beyond = [n for n, body in enumerate(arm.bodies) if body.frame > 2]
    moment = sum(np.cross(posture.centres[:, n] - posture.end_points[2], weights[n]) for n in beyond)
    axes = posture.end_axes[2]
    force = np.tile(weights[beyond].sum(axis=0), (len(q), 1))
    return EndLoad(now, 2, np.einsum("pji,pj->pi", axes, moment), np.einsum("pji,pj->pi", axes, force))


def _height_energy(arm: ArmDescription, masses: Array, posture: Posture) -> Array:
    return np.asarray(-np.einsum("b,pbx,x->p", masses, posture.centres, np.array(arm.gravity_m_per_s2)))


def _slopes(energy: Callable[[Array], Array], count: int, step: float = 1e-5) -> Array:
    return np.stack([(energy(e) - energy(-e)) / (2 * step) for e in step * np.eye(count)], axis=1)


def test_named_deviations_move_what_they_name(arm: ArmDescription) -> None:
    def tcp(name: str, value: float) -> Array:
        truth = replace(GroundTruth.nominal(arm), deviations=Deviations.named(6, {name: value}))
        return true_state(arm, truth, q).tcp_m

    q = random_poses(arm, 15, 10)
    start = true_state(arm, GroundTruth.nominal(arm), q).tcp_m
    np.testing.assert_allclose(tcp("base.y_m", 0.003) - start, [[0.0, 0.003, 0.0]] * 15, atol=1e-15)
    turned = true_state(arm, GroundTruth.nominal(arm), q + np.array([0, 0, 0.02, 0, 0, 0])).tcp_m
    np.testing.assert_allclose(tcp("joint3.theta_rad", 0.02), turned, atol=1e-14)
    for place in ("joint2.extra_z_m", "joint4.d_m", "joint5.a_m", "tool.x_m", "tool.z_m"):
        np.testing.assert_allclose(np.linalg.norm(tcp(place, 0.002) - start, axis=1), 0.002, atol=1e-14)
    with pytest.raises(ValueError, match="joint7"):
        Deviations.named(6, {"joint7.d_m": 1.0})


def test_near_end_bodies_stay_when_their_link_grows(arm: ArmDescription) -> None:
    longer = replace(GroundTruth.nominal(arm), deviations=Deviations.named(6, {"joint2.extra_z_m": 0.01}))
    shift = zero_configuration(arm, longer).centres - zero_configuration(arm, GroundTruth.nominal(arm)).centres
    moved = np.linalg.norm(shift, axis=1)
    assert moved == pytest.approx([0.0, 0.0, *[0.01] * 6])


@pytest.mark.slow
@examples(5, 10)
@given(seed=st.integers(0, 10**6))
def test_play_lifts_and_lowers(arm: ArmDescription, seed: int) -> None:
    q = random_poses(arm, 5, seed)
    truth = GroundTruth.random(arm, seed)
    plain = true_state(arm, truth, q)
    none = true_state(arm, replace(truth, effects=(SoftPlay(2, 0.0, 0.04),)), q)
    np.testing.assert_array_equal(none.tcp_m, plain.tcp_m)
    loose = true_state(arm, replace(truth, effects=(SoftPlay(2, 0.04, 0.04),)), q)
    extra = loose.joints_rad - np.array(truth.joint_compliance_rad_per_nm) * loose.tau_nm
    tau = loose.tau_nm[:, 1]
    np.testing.assert_allclose(extra[:, 1], 0.02 * tau / np.sqrt(tau**2 + 0.04**2), atol=1e-12)
    np.testing.assert_allclose(np.delete(extra, 1, axis=1), 0.0, atol=1e-12)


def test_stiff_beam_is_rigid_and_stiffnesses_are_told_apart(arm: ArmDescription) -> None:
    q = random_poses(arm, 20, 11)
    truth = GroundTruth.nominal(arm)
    rigid = true_state(arm, truth, q).tcp_m
    stiff = true_state(arm, replace(truth, effects=(LinkBending(2, 0.1, (1e12, 1e12)),)), q).tcp_m
    np.testing.assert_allclose(stiff, rigid, atol=1e-11)
    one = true_state(arm, replace(truth, effects=(LinkBending(2, 0.1, (8.0, 1e12)),)), q).tcp_m
    other = true_state(arm, replace(truth, effects=(LinkBending(2, 0.1, (1e12, 8.0)),)), q).tcp_m
    assert np.abs(one - rigid).max() > 1e-3
    assert np.abs(one - other).max() > 1e-3


@dataclass(frozen=True)
class _Everything(HiddenEffect):
    """Uses every hook, so that each is shown to reach the result."""

    def flexible_links(self) -> tuple[int, ...]:
        return (0,)

    def added_masses(self, now: CommandedPoses) -> Array:
        masses = super().added_masses(now)
        masses[:, -1] = 0.01 * now.session
        return masses

    def added_torques(self, load: JointLoad) -> Array:
        return np.asarray(0.01 * load.poses.direction)

    def added_angles(self, load: JointLoad) -> Array:
        return 0.001 * load.poses.q_rad * load.poses.time_s[:, None]

    def link_deflection(self, load: EndLoad) -> Array:
        return np.asarray(super().link_deflection(load) + np.repeat([0.0, 0.001], 3))

    def measurement_error(self, tcp_m: Array) -> Array:
        return np.asarray(0.01 * tcp_m)


def test_every_hook_reaches_the_result(arm: ArmDescription) -> None:
    q = np.deg2rad([[10.0, 20, 0, 0, 0, 0], [10.0, -20, 0, 0, 0, 0], [10.0, -20, 5, 0, 0, 0]])
    plan = synthetic.Schedule(np.array([0.0, 1.0, 2.0]), np.array([1.0, 1.0, 2.0]), np.zeros(6))
    nominal = GroundTruth.nominal(arm)
    hidden = replace(nominal, effects=(_Everything(),))
    state = true_state(arm, hidden, q, schedule=plan)
    np.testing.assert_allclose(state.joints_rad, 0.001 * q * plan.time_s[:, None], atol=1e-12)
    # the same pose without effects, its hand made heavier and its base moved by hand
    shift = np.array([0.0] * 3 + [*zero_configuration(arm, nominal).ends[0].axes @ np.full(3, 0.001)])
    moved = replace(nominal, displacements=(tuple(shift), *nominal.displacements[1:]))
    by_hand = true_state(arm, moved, q + state.joints_rad, 0.01 * plan.session)
    np.testing.assert_allclose(state.tcp_m, by_hand.tcp_m, atol=1e-12)
    signs = [[1, 1, 0, 0, 0, 0], [1, -1, 0, 0, 0, 0], [1, -1, 1, 0, 0, 0]]
    np.testing.assert_allclose(state.tau_nm - by_hand.tau_nm, 0.01 * np.array(signs), atol=1e-12)
    np.testing.assert_allclose(measure(arm, hidden, q, schedule=plan), 1.01 * state.tcp_m, atol=1e-15)


def test_poses_stay_in_limits_above_the_table(arm: ArmDescription) -> None:
    q = random_poses(arm, 200, 12, limit_deg=80.0, floor_m=0.05)
    np.testing.assert_array_equal(q, random_poses(arm, 200, 12, limit_deg=80.0, floor_m=0.05))
    q_deg = np.rad2deg(q)
    assert np.abs(q_deg).max() <= 80.0
    np.testing.assert_allclose(q_deg, np.round(q_deg, 2), atol=1e-12)
    assert true_state(arm, GroundTruth.nominal(arm), q).tcp_m[:, 2].min() > 0.05


@pytest.mark.long
def test_noise_is_normal_with_the_given_spread(arm: ArmDescription) -> None:
    q = np.zeros((4000, 6))
    truth = GroundTruth.nominal(arm)
    noise = measure(arm, truth, q, noise_m=0.0003, seed=13) - measure(arm, truth, q)
    np.testing.assert_allclose(noise.std(axis=0), 0.0003, rtol=0.05)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=0.0003 * 4.5 / math.sqrt(4000))
    assert abs(np.corrcoef(noise.T) - np.eye(3)).max() < 0.08
    np.testing.assert_array_equal(noise, measure(arm, truth, q, noise_m=0.0003, seed=13) - measure(arm, truth, q))


def test_shipped_files_are_reproducible(tmp_path: Path) -> None:
    for file in synthetic.write_example(tmp_path):
        assert file.read_bytes() == (EXAMPLES / file.name).read_bytes(), file.name
    assert len(list(tmp_path.iterdir())) == 3


def test_shipped_files_say_what_they_hold() -> None:
    with (EXAMPLES / "hidden-play.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    joints = [f"q{number}_deg" for number in range(1, 7)]
    assert list(rows[0]) == ["pose", "t_s", "session", "payload_g", *joints, "x_mm", "y_mm", "z_mm"]
    assert [row["pose"] for row in rows] == [str(n) for n in range(1, 301)]
    loads = [row["payload_g"] for row in rows]
    assert (loads.count("0"), loads.count("66.3")) == (150, 150)
    assert all(re.fullmatch(r"-?\d+\.\d{4}", row["x_mm"]) for row in rows)
    about = tomllib.loads((EXAMPLES / "hidden-play.toml").read_text())
    assert about["schema"] == "lrm/measurements/1"
    assert about["start_q_deg"] == [0.0] * 6
    assert about["noise_sd_mm"] == 0.3
    truth = tomllib.loads((EXAMPLES / "hidden-play.truth.toml").read_text())
    (play,) = truth["effect"]
    assert (play["kind"], play["joint"]) == ("SoftPlay", 2)
    assert math.degrees(play["width_rad"]) == pytest.approx(2.3, abs=1e-4)
    assert len(truth["displacement"]) == 8


def test_failed_write_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("os.replace", refuse)
    with pytest.raises(OSError, match="disk full"):
        synthetic.write_example(tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["nominal", "v_loop"])
def test_reference_of_the_published_code(arm: ArmDescription, name: str) -> None:
    if not (REFERENCE / "tcp.csv").is_file():
        pytest.skip("reference values (shared/data/reference beside the repository) are not here; they are not ours")
    with (REFERENCE / "tcp.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["set"] == name]
    assert rows

    def columns(keys: list[str]) -> Array:
        return np.array([[float(row[key]) for key in keys] for row in rows])

    state = true_state(arm, _reference_truth(name), columns([f"q{n}_rad" for n in range(1, 7)]))
    np.testing.assert_allclose(state.tcp_m * 1000.0, columns(["x_mm", "y_mm", "z_mm"]), atol=1e-5, rtol=0.0)
    np.testing.assert_allclose(state.base_moment_nm[:, None] / NM_PER_NMM, columns(["tau_base_Nmm"]), atol=1e-4, rtol=0)
    torques = columns([f"tau{n}_Nmm" for n in range(1, 7)])
    np.testing.assert_allclose(state.tau_nm / NM_PER_NMM, torques, atol=1e-4, rtol=0.0)


def _reference_truth(name: str) -> GroundTruth:
    with (REFERENCE / "parameters.csv").open(newline="") as file:
        raw = {row["parameter"]: float(row[name]) for row in csv.DictReader(file)}
    soft = [raw.pop(f"{place}.k_rad_per_Nmm") / NM_PER_NMM for place in ("base", *(f"joint{n}" for n in range(1, 7)))]
    lengths = {key.removesuffix("_mm") + "_m": value / 1000.0 for key, value in raw.items() if key.endswith("_mm")}
    angles = {key: value for key, value in raw.items() if key.endswith("_rad")}
    return GroundTruth(Deviations.named(6, {**lengths, **angles}), ((0.0,) * 6,) * 8, soft[0], tuple(soft[1:]))
