"""The second catalogue and the causes of somebody else: its effects do what they say, and its table counts rightly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm_file import load_arm as load_tool_arm
from lrm_math.effects import effects_at
from tests.support.sweep import examples
from validation.hidden_effects.case import Case, no_effect
from validation.hidden_effects.cases import OUTSIDE, SINGLE
from validation.hidden_effects.catalogue import EVERY, PARTS, UNFAMILIAR
from validation.hidden_effects.data import ARM_FILE, dataset, unseen
from validation.hidden_effects.outcome import Judgement, Outcome
from validation.hidden_effects.tables import report
from validation.hidden_effects.unforeseen import BLIND_CASES
from validation.proofs.hidden_effects import rows as proof_rows
from validation.synthetic import (
    DahlLoop,
    HardStop,
    HingedLink,
    LinkBending,
    StickSlip,
    TwoStageWarmUp,
    even_schedule,
    load_arm,
    random_poses,
)
from validation.synthetic.hidden_effect import CommandedPoses, EndLoad, HiddenEffect, JointLoad
from validation.synthetic.hidden_joints import BeltPolygon
from validation.synthetic.hidden_links import GlareSpot, WalkingBase
from validation.synthetic.hidden_memory import FanCycles, SlippingClutch, ViscoelasticJoint
from validation.synthetic.hidden_tracker import FoamMat, StereoSteps
from validation.synthetic.screws import Array


def joint_load(q: Array, tau: Array) -> JointLoad:
    """One moving joint of the lab arm, a pose every 15 s."""
    plan = even_schedule(len(q), 6)
    turned = np.zeros((len(q), 6))
    turned[:, 0] = q
    side = np.sign(np.diff(turned, axis=0, prepend=0.0))
    poses = CommandedPoses(load_arm(ARM_FILE), turned, side, plan.time_s, plan.session, np.zeros(len(q)))
    torque = np.zeros((len(q), 6))
    torque[:, 0] = tau
    return JointLoad(poses, torque)


def angle_error(effect: HiddenEffect, q: Array, tau: Array | None = None) -> Array:
    return np.asarray(effect.added_angles(joint_load(q, np.zeros(len(q)) if tau is None else tau))[:, 0])


@given(st.integers(0, 2**32 - 1))
@examples(10, 20)
def test_friction_lags_behind_the_last_move_within_its_width(seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-1.5, 1.5, 30)
    side = np.sign(np.diff(q, prepend=0.0))
    dahl, slip = angle_error(DahlLoop(1, 0.02, 0.3), q), angle_error(StickSlip(1, 0.02, 0.01, 0.0), q)
    assert np.abs(dahl).max() <= 0.01
    far = np.abs(np.diff(q, prepend=0.0)) > 0.1
    np.testing.assert_allclose(slip[far], -0.01 * side[far])
    assert (dahl[far] * side[far] < 0.005).all()


def test_a_joint_sticks_in_small_moves() -> None:
    q = np.array([0.5, 0.505, 0.51, 0.9])
    np.testing.assert_allclose(angle_error(StickSlip(1, 0.025, 0.01, 0.0), q), [-0.01, -0.015, -0.02, -0.01])


def test_creep_follows_a_step_with_its_time_constant() -> None:
    tau = np.array([0.0, 0.0, 1.0, 1.0, 1.0])
    found = angle_error(ViscoelasticJoint(1, 0.1, (15.0,)), np.zeros(5), tau)
    np.testing.assert_allclose(found, [0.0, 0.0, *(0.1 * (1.0 - np.exp([-1.0, -2.0, -3.0])))])


def test_a_stop_lets_only_a_share_pass() -> None:
    found = angle_error(HardStop(1, 1, 1.0, 0.7, 1e-6), np.array([0.5, 1.0, 1.5]))
    np.testing.assert_allclose(found, [0.0, 0.0, -0.15], atol=1e-6)


def test_two_stages_warm_up_to_their_sum_and_cool_in_a_break() -> None:
    load = joint_load(np.zeros(1000), np.zeros(1000))
    broken = replace(load.poses, time_s=load.poses.time_s + 1e6 * (np.arange(1000) == 999))
    cold = replace(broken, session=1.0 + (np.arange(1000) == 999))
    found = TwoStageWarmUp(1, (0.01, 0.02), (100.0, 900.0)).added_angles(JointLoad(cold, load.tau_nm))[:, 0]
    assert found[998] == pytest.approx(0.03, rel=1e-4)
    assert found[999] == pytest.approx(0.0, abs=1e-12)


def test_a_hinge_at_the_end_is_a_short_stiff_end_and_at_the_root_a_lever() -> None:
    """Independent: the beam formula with all its compliance in a short piece at the root."""
    load = joint_load(np.zeros(4), np.zeros(4))
    rng = np.random.default_rng(0)
    end = EndLoad(load.poses, 2, rng.normal(size=(4, 3)), rng.normal(size=(4, 3)))
    at_end = HingedLink(2, 0.0, (0.1, 0.1)).link_deflection(end)
    np.testing.assert_allclose(at_end[:, 3:], 0.0)
    np.testing.assert_allclose(at_end[:, :2], 0.1 * end.moment_nm[:, :2])
    short = 1e-6
    at_root = HingedLink(2, 0.1, (0.1, 0.1)).link_deflection(end)
    arm = np.array([0.0, 0.0, 0.1])
    at_hinge = EndLoad(load.poses, 2, end.moment_nm + np.cross(arm, end.force_n), end.force_n)
    beam = LinkBending(2, short, (short / 0.1, short / 0.1)).link_deflection(at_hinge)
    np.testing.assert_allclose(at_root[:, :3], beam[:, :3], atol=1e-6)
    np.testing.assert_allclose(at_root[:, 3:], beam[:, 3:] + np.cross(beam[:, :3], arm), atol=1e-6)


@pytest.mark.parametrize("name", sorted({case.arm for case in UNFAMILIAR.values()}))
def test_arms_are_read_alike_by_generator_and_tool(name: str) -> None:
    path = next(case for case in UNFAMILIAR.values() if case.arm == name).arm_file
    arm, tool = load_arm(path), load_tool_arm(str(path))
    assert len(arm.links) == tool.dof
    assert sum(body.mass_kg for body in arm.bodies) == pytest.approx(sum(body.mass for body in tool.bodies))


def test_the_halves_share_no_case() -> None:
    halves = {half: [c for c in UNFAMILIAR.values() if c.part == half] for half in ("tune", "report")}
    assert min(len(cases) for cases in halves.values()) >= 25
    shared = {case.name for case in halves["tune"]} & {case.name for case in halves["report"]}
    assert shared <= {"nothing"}


def test_every_right_name_is_an_effect_of_the_tool_at_a_place_of_the_arm() -> None:
    for case in EVERY.values():
        arm = load_tool_arm(str(case.arm_file))
        assert all(effects_at(arm, name) for name in case.truth or ()), case.key


@pytest.mark.slow
@pytest.mark.parametrize("name", ["play2, outliers/tune", "shaft2, five levels/tune", "nothing, one load/tune"])
def test_data_are_as_the_case_asks(name: str) -> None:
    case = UNFAMILIAR[name]
    data, again = dataset(case, 0, 60), dataset(case, 0, 60)
    np.testing.assert_array_equal(data.tcp_m, again.tcp_m)
    assert set(data.payload_kg) <= set(case.loads_kg)
    if case.levels_deg:
        assert set(np.round(np.degrees(data.q_rad), 6).reshape(-1)) <= set(case.levels_deg)
    clean = dataset(replace(case, outliers=0.0), 0, 60)
    moved = np.linalg.norm(data.tcp_m - clean.tcp_m, axis=1)
    assert (moved > 0.004).sum() == (moved > 0.0).sum() == round(60 * case.outliers)
    assert not np.array_equal(unseen(case, 0, 60).q_rad, data.q_rad)


def test_counts_of_a_run() -> None:
    one, two = "unequal-play2/tune", "unequal-play2+gear1/tune"
    right = Outcome(one, 0, (("backlash@joint2",),), "nothing_missing", 1.05, findings=(True,), z=(0.5,))
    in_class = Outcome(one, 0, (("mass@link2", "backlash@joint2"),), "nothing_missing", 1.3, findings=(True,))
    names = (("backlash@joint2",), ("mass@link2",), ("compliance@joint5",))
    false = Outcome(one, 0, names, "", 1.02, findings=(True, True, True))
    described = replace(false, findings=(True, False, True))
    half = Outcome(two, 0, (("backlash@joint2",),), "unexplained_structure", 3.0, findings=(True,))
    failed = Outcome(one, 0, trouble="it | broke")
    assert right.all_named and in_class.all_named and false.all_named  # noqa: PT018
    assert not half.all_named
    assert [bool(one.false_names) for one in (right, in_class, false, half)] == [False, False, True, False]
    assert [one.false_findings for one in (right, in_class, false, described)] == [(), (), ("mass@link2",), ()]
    assert [one.falsely_content for one in (right, in_class, half)] == [False, True, False]
    text = report([right, false, half, failed], "tune")
    assert "| one effect | 3 | 1 (33 %) | 0 (0 %) | 1 (33 %) | 1 (33 %) | 1 (33 %) | 1.05 (1.05) | – | 1 of 1 |" in text
    assert "backlash@joint2 ×1; backlash@joint2 > mass@link2 > compliance@joint5 ×1; – ×1" in text
    assert "- 1 × it / broke" in text


def test_an_outcome_is_right_honest_or_false() -> None:
    """By what somebody would believe: an identified cause that is none, and contentment above the noise, are false."""
    one = Outcome("unequal-play2/tune", 0, (("backlash@joint2",),), "nothing_missing", 1.05, findings=(True,))
    alien = Outcome("shared-supply/unforeseen", 0, verdict="unexplained_structure", ratio=4.8)
    idle = Outcome("nothing/tune", 0, verdict="nothing_missing", ratio=1.02)
    fault = Outcome("a loose screw/faults", 0, verdict="unpredictable", ratio=2.0, right=())
    wrong = {"steps": (("mass@link2",),)}
    cases = {
        Judgement.RIGHT: (one, idle, replace(one, findings=(False,))),
        Judgement.HONEST: (
            alien, replace(alien, **wrong, findings=(False,)), fault, replace(one, **wrong, findings=(False,)),
            replace(idle, verdict="unexplained_structure"),
        ),
        Judgement.FALSE: (
            replace(one, **wrong), replace(alien, **wrong, findings=(True,)), replace(one, ratio=1.3),
            replace(idle, ratio=1.3),
        ),
        Judgement.FAILED: (replace(one, trouble="CommandFailed"),),
    }  # fmt: skip
    for judgement, outcomes in cases.items():
        assert [outcome.judgement for outcome in outcomes] == [judgement] * len(outcomes)
    assert [outcome.hidden for outcome in (one, alien, idle, fault)] == [True, None, False, None]
    table = {
        row[:2]: row[2:7]
        for row in proof_rows([replace(one, case="unequal-play3/report", steps=(("backlash@joint3",),)), alien])
    }
    assert table["other forms, arms and awkward data", "known effects"] == (1, 1, 0, 0, 0)
    assert table["causes thought of by others", "no known effect fits"] == (1, 0, 1, 0, 0)


def test_faults_and_memories_are_right_by_their_first_name() -> None:
    """What is right for a fault comes with its data; freed offsets are always true, and no name."""
    of, right = "the board's clock is wrong/faults", ("common_gain@servos",)
    named = Outcome(of, 0, (("offsets@joint2",), right), "nothing_missing", 1.0, findings=(True, True), right=right)
    wrong = Outcome(of, 1, (("backlash@joint2",),), "nothing_missing", 1.0, findings=(False,), right=right)
    quiet = Outcome("healthy/faults", 0, verdict="nothing_missing", ratio=1.0, right=())
    slipped = Outcome("slip2/memory", 0, (("slip@joint2",),), "", 1.1, findings=(True,), right=("slip@joint2",))
    judged = [one.judgement for one in (named, wrong, quiet, slipped)]
    assert judged == [Judgement.RIGHT, Judgement.HONEST, Judgement.RIGHT, Judgement.RIGHT]
    text = report([named, wrong, quiet], "faults")
    assert "| a fault of the measurement | 2 | 1 (50 %) | 1 (50 %) | 0 (0 %) | 0 (0 %) | 1 (50 %) |" in text
    assert "(backlash@joint2) ×1" in text


def test_every_case_has_a_key_of_its_own_and_a_part() -> None:
    assert sum(map(len, PARTS.values())) == len(EVERY)
    assert all(PARTS.values())
    assert all(EVERY[key].key == key for key in EVERY)


RNG = np.random.default_rng(1)


def random_motion(count: int) -> CommandedPoses:
    arm, plan = load_arm(ARM_FILE), even_schedule(count, 6)
    q = random_poses(arm, count, 0)
    return CommandedPoses(arm, q, np.sign(np.diff(q, axis=0, prepend=0.0)), plan.time_s, plan.session, np.zeros(count))


def random_load(count: int) -> JointLoad:
    return JointLoad(random_motion(count), RNG.normal(size=(count, 6)))


def test_worlds_have_names_of_their_own_and_stand_on_three_arms() -> None:
    assert len({case.name for case in BLIND_CASES}) == len(BLIND_CASES)
    assert {case.arm for case in BLIND_CASES} == {"lrm-lab", "so101-like", "ur5-like"}


def test_what_repeats_with_the_angle_or_the_time_repeats() -> None:
    load = random_load(400)
    turned = replace(load.poses, q_rad=load.poses.q_rad + 2.0 * np.pi / 20)
    belt = BeltPolygon(2, 20, 0.01)
    found = belt.added_angles(load)
    np.testing.assert_allclose(found, belt.added_angles(JointLoad(turned, load.tau_nm)), atol=1e-12)
    assert found[:, 1].min() >= -4.0 / 300
    assert found[:, 1].max() <= 2.0 / 300
    warm = FanCycles(2, 0.02, 960.0).added_angles(load)[:, 1]
    np.testing.assert_allclose(warm[:300], warm[64:364], atol=1e-12)
    assert np.abs(np.diff(warm)).max() < 0.002


def test_cameras_err_along_their_sight_by_half_a_step_at_most() -> None:
    tcp, camera, step = RNG.uniform(-0.3, 0.3, (50, 3)), np.array([1.0, 0.0, 0.5]), 0.006
    error = StereoSteps((1.0, 0.0, 0.5), step).measurement_error(tcp)
    sight = tcp - camera
    np.testing.assert_allclose(np.cross(error, sight), 0.0, atol=1e-12)
    apart = 1.0 / np.linalg.norm(sight + error, axis=1) - 1.0 / np.linalg.norm(sight, axis=1)
    assert np.abs(apart).max() <= step / 2.0 + 1e-12


def test_a_bright_spot_moves_across_the_sight_only() -> None:
    force = RNG.normal(size=(20, 3))
    spot = GlareSpot(6, 0.003).link_deflection(EndLoad(random_motion(20), 6, np.zeros((20, 3)), force))
    np.testing.assert_allclose((spot[:, 3:] * force).sum(axis=1), 0.0, atol=1e-12)
    assert not spot[:, :3].any()


def test_foam_only_lifts_and_only_below_its_top() -> None:
    tcp = RNG.uniform(0.0, 0.5, (50, 3))
    error = FoamMat(0.2, 0.5).measurement_error(tcp)
    np.testing.assert_array_equal(error[:, 2] > 0.0, tcp[:, 2] < 0.2)
    assert not error[:, :2].any()


def test_what_slips_stays_where_it_slipped_to() -> None:
    load = random_load(60)
    clutch = SlippingClutch(3, 1e9, 1.0).added_angles(load)
    assert not clutch.any()
    slipped = np.diff(SlippingClutch(3, 0.2, 0.01).added_angles(load)[:, 2])
    assert 0 < np.count_nonzero(slipped) < len(slipped)
    walked = WalkingBase(0.01, 1.0).link_deflection(EndLoad(load.poses, 0, np.zeros((60, 3)), np.zeros((60, 3))))
    wide = np.abs(np.diff(load.poses.q_rad[:, 0], prepend=0.0)) > 1.0
    np.testing.assert_array_equal(np.diff(walked[:, 2], prepend=0.0) != 0.0, wide)


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize("case", [*SINGLE.values(), *OUTSIDE.values(), *BLIND_CASES], ids=lambda case: case.key)
def test_what_is_hidden_moves_the_tip_by_some_millimetres(case: Case) -> None:
    apart = dataset(case, 0, 120).tcp_m - dataset(replace(case, build=no_effect), 0, 120).tcp_m
    rms, spread = (np.sqrt((moved**2).sum(axis=1).mean()) for moved in (apart, apart - apart.mean(axis=0)))
    assert case.truths == () or (rms > 0.0005 and spread < 0.006), (
        f"{rms * 1e3:.2f} mm, about its mean {spread * 1e3:.2f}"
    )
