"""The generator's hidden effects, each on its own, and the data sets and tables of `validation.hidden_effects`."""

from __future__ import annotations

import csv
import math
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from lrm_math.effects import CATALOGUE
from validation import synthetic
from validation.hidden_effects import examine
from validation.hidden_effects.cases import CASES, SINGLE
from validation.hidden_effects.data import ARM_FILE, write_case
from validation.hidden_effects.outcome import Judgement
from validation.synthetic import (
    ArmDescription,
    AxialFloat,
    BaseRocking,
    BaseWarmUp,
    CablePull,
    CoupledJoint,
    DahlLoop,
    EccentricShaft,
    FastClock,
    FormulaJoint,
    FrictionLag,
    GroundTruth,
    HardeningSpring,
    HardStop,
    HiddenEffect,
    HingedLink,
    JointSlip,
    LiftingBase,
    LinkBending,
    OneSidedGain,
    RadialFloat,
    Schedule,
    SessionStep,
    SharedCable,
    SkewTracker,
    SoftPlay,
    StickSlip,
    TiltingBearing,
    ToothRipple,
    TwoStageWarmUp,
    WarmUp,
    WrongBody,
    WrongLoad,
    base_displacement_to_deviations,
    even_schedule,
    measure,
    random_poses,
    true_state,
)
from validation.synthetic.chain import zero_configuration
from validation.synthetic.screws import Array

NONE = (0.0, 0.0, 0.0)
OF_SIZE_ZERO = [
    BaseRocking(0.0, (1.0, 0.0, 0.0)),
    BaseWarmUp(NONE, (500.0, 2000.0)),
    CablePull(1, 1, -1.0, 0.0, 2.0),
    CoupledJoint(3, 2, 0.0, 1.5),
    EccentricShaft(2, 0.0, 1.0),
    FastClock(0.0, 2.6),
    FrictionLag(1, 0.0, 0.1),
    HardeningSpring(2, 0.0, 0.1),
    LinkBending(2, 0.0, (1.0, 2.0)),
    OneSidedGain(1, 1, 0.0, 0.1),
    SessionStep(1, (0.0, 0.0)),
    JointSlip(2, 0.0, 400.0),
    SkewTracker(NONE, NONE, NONE),
    SoftPlay(2, 0.0, 0.04),
    WarmUp(2, 0.0, 1000.0),
    WrongBody("link 3", 0.0),
    WrongLoad(0.0),
    AxialFloat(2, 0.0, 1.0),
    RadialFloat(2, 0.0, 1.0),
    HingedLink(2, 0.1, (0.0, 0.0)),
    LiftingBase((1.0, 0.0, 0.0), 0.0, 0.1, 0.05),
    TiltingBearing(2, 0.0, 0.1),
    DahlLoop(1, 0.0, 0.5),
    FormulaJoint(2, 0.0, "np.sin(q[1] + tau) * side"),
    ToothRipple(2, 5, 0.0, 0.3),
    HardStop(2, 1, 1.0, 1.0, 0.1),
    SharedCable((2, 4), 0.5, 0.0),
    StickSlip(1, 0.0, 0.0, 1.0),
    TwoStageWarmUp(2, (0.0, 0.0), (500.0, 3000.0)),
]


@pytest.fixture(scope="module")
def arm() -> ArmDescription:
    return synthetic.load_arm(ARM_FILE)


@pytest.fixture(scope="module")
def stiff(arm: ArmDescription) -> GroundTruth:
    return GroundTruth.nominal(arm)


def angles(
    arm: ArmDescription, truth: GroundTruth, effect: HiddenEffect, q: Array, schedule: Schedule | None = None
) -> Array:
    """(P, N): what the effect adds to the joints of a rigid arm."""
    return true_state(arm, replace(truth, effects=(effect,)), q, 0.05, schedule).joints_rad


def test_the_list_of_effects_is_complete() -> None:
    kinds = {
        v
        for v in vars(synthetic).values()
        if isinstance(v, type) and issubclass(v, HiddenEffect) and v is not HiddenEffect
    }
    assert {type(effect) for effect in OF_SIZE_ZERO} == kinds


@pytest.mark.slow
@pytest.mark.parametrize("effect", OF_SIZE_ZERO, ids=lambda effect: type(effect).__name__)
def test_size_zero_changes_nothing(arm: ArmDescription, effect: HiddenEffect) -> None:
    np.testing.assert_allclose(measured_at_times(arm, effect), measured_at_times(arm, None), atol=1e-13)


@cache
def measured_at_times(arm: ArmDescription, effect: HiddenEffect | None) -> Array:
    """(15, 3), positions of a random arm with an effect, at two sessions' poses."""
    q, truth = random_poses(arm, 15, 1), GroundTruth.random(arm, 1)
    plan = Schedule(60.0 * np.arange(15.0), np.array([1.0, 2.0, 2.0] * 5), np.zeros(6))
    return measure(arm, replace(truth, effects=(effect,) if effect else ()), q, 0.05, schedule=plan)


def test_base_bends_about_its_beta_axis(arm: ArmDescription) -> None:
    """Beta and a deflection add up, whatever alpha and gamma are."""
    q = random_poses(arm, 10, 2)
    names = {"base.alpha_rad": 0.3, "base.beta_rad": -0.2, "base.gamma_rad": 0.5}
    soft = replace(
        GroundTruth.nominal(arm),
        deviations=synthetic.Deviations.named(6, names),
        base_compliance_rad_per_nm=0.02,
    )
    bent = true_state(arm, soft, q)
    for row, angle in enumerate(bent.base_rad):
        turned = synthetic.Deviations.named(6, names | {"base.beta_rad": -0.2 + float(angle)})
        rigid = true_state(arm, replace(soft, deviations=turned, base_compliance_rad_per_nm=0.0), q[row : row + 1])
        np.testing.assert_allclose(rigid.tcp_m[0], bent.tcp_m[row], atol=1e-12)
        np.testing.assert_allclose(rigid.base_moment_nm[0], bent.base_moment_nm[row], atol=1e-12)


def test_naming_the_base_errors_leaves_the_rigid_arm_as_it_is(arm: ArmDescription) -> None:
    truth = GroundTruth.random(arm, 3)
    named = base_displacement_to_deviations(arm, truth)
    assert not any(named.displacements[0])
    before, after = zero_configuration(arm, truth), zero_configuration(arm, named)
    for name in ("joint_axes", "joint_points", "centres", "tcp"):
        np.testing.assert_allclose(getattr(after, name), getattr(before, name), atol=1e-14)
    np.testing.assert_allclose(after.ends[0].axes, before.ends[0].axes, atol=1e-14)
    assert after.base_axis[0] == pytest.approx(0.0, abs=1e-15)  # x is where alpha turns about


def test_drift_follows_the_clock_and_sessions_their_number(arm: ArmDescription, stiff: GroundTruth) -> None:
    q, when = np.zeros((4, 6)), np.array([0.0, 600.0, 1800.0, 1e6])
    plan = Schedule(when, np.array([1.0, 1.0, 2.0, 3.0]), np.zeros(6))
    warm = angles(arm, stiff, WarmUp(2, 0.01, 1800.0), q, plan)
    np.testing.assert_allclose(warm[:, 1], 0.01 * np.array([0.0, 1 - math.exp(-1 / 3), 1 - math.exp(-1), 1.0]))
    assert not np.delete(warm, 1, axis=1).any()
    steps = angles(arm, stiff, SessionStep(3, (0.0, 0.01, -0.02)), q, plan)
    np.testing.assert_allclose(steps[:, 2], [0.0, 0.0, 0.01, -0.02])
    tilting = replace(stiff, effects=(BaseWarmUp((0.0, 0.01, 0.0), (500.0, 2000.0)),))
    moved = true_state(arm, tilting, q, schedule=plan).tcp_m - true_state(arm, stiff, q).tcp_m
    size = np.linalg.norm(moved, axis=1)
    assert size[0] == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.diff(size) > 0.0)
    lever = true_state(arm, stiff, q[:1]).tcp_m[0] - zero_configuration(arm, stiff).ends[0].origin
    assert size[3] == pytest.approx(0.01 * np.linalg.norm(lever[[0, 2]]), rel=1e-4)


def test_hardening_spring_keeps_its_slope_at_zero_and_gets_stiffer(arm: ArmDescription) -> None:
    truth = replace(GroundTruth.nominal(arm), joint_compliance_rad_per_nm=(0.0, 0.08, 0.0, 0.0, 0.0, 0.0))
    state = true_state(arm, replace(truth, effects=(HardeningSpring(2, 0.006, 0.1),)), random_poses(arm, 200, 4))
    tau, angle = state.tau_nm[:, 1], state.joints_rad[:, 1]
    order = np.argsort(tau)
    slope = np.diff(angle[order]) / np.diff(tau[order])
    middle = np.abs(tau[order][1:] + tau[order][:-1]) / 2.0
    assert np.all(slope > 0.0)
    assert slope[middle < 0.01] == pytest.approx(0.08, abs=1e-3)
    assert slope[middle > 0.4].max() < 0.04


def test_one_sided_gain_acts_on_one_side(arm: ArmDescription, stiff: GroundTruth) -> None:
    q = np.deg2rad(np.outer([-90.0, -1.0, 0.0, 90.0], np.ones(6)))
    for side, near, far in ((1, 3, 0), (-1, 0, 3)):
        extra = angles(arm, stiff, OneSidedGain(4, side, 0.03, 0.1), q)[:, 3]
        assert extra[2] == 0.0
        assert extra[near] / q[near, 3] == pytest.approx(0.03, rel=0.05)
        assert abs(extra[far]) < 0.03 * 0.1


def test_eccentric_shaft_is_the_angle_from_the_other_centre(arm: ArmDescription, stiff: GroundTruth) -> None:
    """Seen from a centre at distance e, the point at angle q stands at arg(exp(iq) - e exp(i phase))."""
    q, e, phase = random_poses(arm, 30, 5), 0.3, 2.5
    extra = angles(arm, stiff, EccentricShaft(2, e, phase), q)[:, 1]
    seen = np.exp(1j * q[:, 1]) - e * np.exp(1j * phase)
    start = 1.0 - e * np.exp(1j * phase)
    np.testing.assert_allclose(np.exp(1j * (q[:, 1] + extra)), seen / np.abs(seen) * np.conj(start) / abs(start))


def test_friction_lags_behind_the_last_move(arm: ArmDescription, stiff: GroundTruth) -> None:
    q = np.zeros((5, 6))
    q[:, 0] = np.deg2rad([30.0, 60.0, 60.0, -20.0, -20.5])
    lag = angles(arm, stiff, FrictionLag(1, 0.02, math.radians(2.0)), q)[:, 0]
    np.testing.assert_allclose(lag[:4], [-0.01, -0.01, -0.01, 0.01], rtol=1e-6)
    assert lag[4] == pytest.approx(0.01)
    q[4, 0] = math.radians(-19.5)
    turned = angles(arm, stiff, FrictionLag(1, 0.02, math.radians(2.0)), q)[4, 0]
    assert turned == pytest.approx(0.01 * (2.0 * math.exp(-0.25) - 1.0))


def test_a_cable_pulls_back_where_it_is_tight(arm: ArmDescription, stiff: GroundTruth) -> None:
    q = np.deg2rad(np.outer([-90.0, 0.0, 45.0, 90.0], [0, 0, 0, 1, 0, 0]))
    effect = CablePull(4, 1, 0.0, 0.1, 3.0)
    pull = true_state(arm, replace(stiff, effects=(effect,)), q).tau_nm - true_state(arm, stiff, q).tau_nm
    assert not pull[:2].any()
    assert not np.delete(pull, 3, axis=1).any()
    assert 2.0 < pull[3, 3] / pull[2, 3] < 3.0
    assert pull[3, 3] < -0.1 * math.pi / 2.0
    # a rigid joint does not feel it; it reaches the angle by the compliance
    assert not angles(arm, stiff, effect, q).any()
    soft = replace(stiff, joint_compliance_rad_per_nm=(0.0, 0.0, 0.0, 0.08, 0.0, 0.0))
    state = true_state(arm, replace(soft, effects=(effect,)), q)
    np.testing.assert_allclose(state.joints_rad[:, 3], 0.08 * state.tau_nm[:, 3], atol=1e-12)


def test_coupled_joint_follows_the_other(arm: ArmDescription, stiff: GroundTruth) -> None:
    q = random_poses(arm, 20, 6)
    coupled = angles(arm, stiff, CoupledJoint(3, 2, 0.02, 1.5), q)
    np.testing.assert_allclose(coupled[:, 2], 0.03 * np.sin(q[:, 1] / 1.5))
    assert not np.delete(coupled, 2, axis=1).any()


def test_a_formula_knows_angles_ways_torques_side_load_and_time(arm: ArmDescription, stiff: GroundTruth) -> None:
    q, plan = random_poses(arm, 20, 6), even_schedule(20, 6)
    tau = true_state(arm, stiff, q, 0.05).tau_nm
    way = np.diff(q, axis=0, prepend=0.0)
    for formula, values in {
        "q[1] * q[4]": q[:, 0] * q[:, 3],
        "way[2]": way[:, 1],
        "side": np.sign(way[:, 2]),
        "tau + torque[2]": tau[:, 2] + tau[:, 1],
        "load_kg * time_s": 0.05 * plan.time_s,
    }.items():
        extra = angles(arm, stiff, FormulaJoint(3, 1e-6, formula), q)
        np.testing.assert_allclose(extra[:, 2], 1e-6 * values, rtol=1e-3, atol=1e-12)
        assert not np.delete(extra, 2, axis=1).any()


@pytest.mark.slow
def test_rocking_base_turns_by_its_moment(arm: ArmDescription, stiff: GroundTruth) -> None:
    """Softly about the base's y axis it is what the base's own compliance is."""
    q = random_poses(arm, 15, 7)
    own = true_state(arm, replace(stiff, base_compliance_rad_per_nm=0.01), q, 0.05)
    rocking = true_state(arm, replace(stiff, effects=(BaseRocking(0.01, (0.0, 1.0, 0.0)),)), q, 0.05)
    np.testing.assert_allclose(rocking.tcp_m, own.tcp_m, atol=1e-12)
    other = true_state(arm, replace(stiff, effects=(BaseRocking(0.01, (1.0, 0.0, 0.0)),)), q, 0.05)
    assert np.abs(other.tcp_m - own.tcp_m).max() > 1e-3


def test_a_heavier_load_is_the_load_it_is(arm: ArmDescription) -> None:
    q, truth = random_poses(arm, 20, 8), GroundTruth.random(arm, 8)
    said = np.tile([0.0, 0.0663], 10)
    state = true_state(arm, replace(truth, effects=(WrongLoad(0.015),)), q, said)
    honest = true_state(arm, truth, q, np.where(said > 0.0, said + 0.015, 0.0))
    np.testing.assert_allclose(state.tcp_m, honest.tcp_m, atol=1e-12)


@pytest.mark.slow
def test_wrong_centres_are_those_of_a_rig_with_the_centres_moved(arm: ArmDescription) -> None:
    q, truth = random_poses(arm, 10, 9), GroundTruth.random(arm, 9)
    shift = (0.01, -0.02, 0.03)

    def described(name: str, mass_kg: float, com_m: Array) -> ArmDescription:
        x, y, z = com_m.tolist()
        bodies = [replace(b, mass_kg=mass_kg, com_m=(x, y, z)) if b.name == name else b for b in arm.bodies]
        return replace(arm, bodies=tuple(bodies))

    link = next(body for body in arm.bodies if body.name == "link 2")
    wrong = true_state(arm, replace(truth, effects=(WrongBody("link 2", 0.4, shift),)), q, 0.05)
    right = true_state(described("link 2", 1.4 * link.mass_kg, np.array(link.com_m) + shift), truth, q, 0.05)
    np.testing.assert_allclose(wrong.tcp_m, right.tcp_m, atol=1e-12)

    screw = next(body for body in arm.bodies if body.carries_payload)
    load, whole = 0.05 + 0.01, screw.mass_kg + 0.05 + 0.01
    common = (screw.mass_kg * np.array(screw.com_m) + load * (np.array(screw.com_m) + shift)) / whole
    hung = true_state(arm, replace(truth, effects=(WrongLoad(0.01, shift),)), q, 0.05)
    by_hand = true_state(described(screw.name, whole, common), truth, q, 0.0)
    np.testing.assert_allclose(hung.tcp_m, by_hand.tcp_m, atol=1e-12)
    np.testing.assert_allclose(hung.base_moment_nm, by_hand.base_moment_nm, atol=1e-12)


def test_skew_tracker_stretches_leans_and_turns(arm: ArmDescription, stiff: GroundTruth) -> None:
    q = random_poses(arm, 10, 10)
    tcp = true_state(arm, stiff, q).tcp_m

    def seen(effect: SkewTracker) -> Array:
        return measure(arm, replace(stiff, effects=(effect,)), q)

    np.testing.assert_allclose(seen(SkewTracker(NONE, (0.01, 0.0, -0.02), NONE)), tcp * [1.01, 1.0, 0.98])
    turned = seen(SkewTracker((0.0, 0.0, math.pi / 2.0), NONE, NONE))
    np.testing.assert_allclose(turned, tcp[:, [1, 0, 2]] * [-1.0, 1.0, 1.0], atol=1e-15)
    leaning = seen(SkewTracker(NONE, NONE, (0.1, 0.0, 0.0))) - tcp
    np.testing.assert_allclose(leaning[:, 0], math.tan(0.1) * tcp[:, 1])
    assert not leaning[:, 1:].any()


WITHOUT_TWIN = {
    "offsets": "always fitted",
    "compliance": "always fitted",
    "quantisation": "known, never fitted",
    "anchor": "no distances in the cases; tests/ident/data/test_distances.py",
    "gravity": "its twin are the leaning bases of validation/as_deployed; tests/ident/diagnosis/test_leaning_base.py",
    "servo_droop": "no joint feedback in the cases",
    "axial_play": "its twin AxialFloat is among the cases of other forms",
    "gear_ripple": "its twin GearRipple is among the cases of other forms",
    "depth_scale": "its twins SkewTracker and DepthTracker are among the worlds of validation/as_deployed",
    "creep": "its twins are in hidden_effects/memory.py; tests/ident/diagnosis/test_memory.py",
    "self_heating": "its twin HeatedServo is in validation/hidden_effects/memory.py",
    "slip": "its twin SlippingHorn is in validation/hidden_effects/memory.py",
    "tool_compliance": "its twin is in tests/ident/diagnosis/test_soft_mount.py",
    "settling_error": "its twin is in tests/ident/diagnosis/test_read_too_early.py",
}


def test_every_effect_of_the_catalogue_has_a_twin_in_the_independent_generator() -> None:
    named = {place.partition("@")[0] for case in SINGLE.values() for place in case.truth or ()}
    forgotten = sorted({kind.id for kind in CATALOGUE} - named - set(WITHOUT_TWIN))
    assert not forgotten, f"write a HiddenEffect in lrm_ident/synthetic and a single case of {', '.join(forgotten)}"


@pytest.mark.slow
def test_case_files_repeat_and_are_mixed(tmp_path: Path) -> None:
    case = CASES["restart1"]
    (tmp_path / "again").mkdir()
    path = write_case(case, 3, 60, tmp_path)
    assert write_case(case, 3, 60, tmp_path / "again").read_bytes() == path.read_bytes()
    assert write_case(case, 4, 60, tmp_path / "again").read_bytes() != path.read_bytes()
    about = tomllib.loads(path.with_suffix(".toml").read_text())
    assert (about["arm"], about["noise_sd_mm"]) == ("lrm-lab", 0.3)
    truth = tomllib.loads(path.with_suffix(".truth.toml").read_text())
    assert [effect["kind"] for effect in truth["effect"]] == ["SessionStep"]
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["session"] for row in rows} == {"1", "2", "3"}
    assert {row["payload_g"] for row in rows} == {"0", "66.3"}
    time, load, q1 = (np.array([float(row[key]) for row in rows]) for key in ("t_s", "payload_g", "q1_deg"))
    assert np.all(np.diff(time) > 0.0)
    assert np.abs(np.corrcoef([time, load, q1]) - np.eye(3)).max() < 0.4


@pytest.mark.slow
def test_a_hidden_effect_is_named_and_added(tmp_path: Path) -> None:
    found = examine.examine(("play2", 0, ""), 80, tmp_path)
    assert found.judgement is Judgement.RIGHT, found
    assert found.ratio is not None
    assert found.ratio < 1.15
    assert [path.name for path in sorted(tmp_path.rglob("*.csv"))] == ["play2-0-80.csv"]


def test_a_failure_is_in_the_outcome(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(examine.WAYS, "named", lambda *_: 1 / 0)
    assert "ZeroDivisionError" in examine.examine(("play2", 0, ""), 20, tmp_path).trouble
