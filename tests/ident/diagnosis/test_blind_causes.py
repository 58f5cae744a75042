"""Causes by somebody who had not read how `auto` decides do what they say, and move the tip by some millimetres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from validation.hidden_effects.case import Case
from validation.hidden_effects.data import ARM_FILE, dataset
from validation.hidden_effects.unforeseen import BLIND_CASES
from validation.synthetic import even_schedule, load_arm, random_poses
from validation.synthetic.hidden_effect import CommandedPoses, EndLoad, JointLoad
from validation.synthetic.hidden_joints import BeltPolygon
from validation.synthetic.hidden_links import GlareSpot, WalkingBase
from validation.synthetic.hidden_memory import FanCycles, SlippingClutch
from validation.synthetic.hidden_tracker import FoamMat, StereoSteps

RNG = np.random.default_rng(1)


def poses(count: int) -> CommandedPoses:
    arm, plan = load_arm(ARM_FILE), even_schedule(count, 6)
    q = random_poses(arm, count, 0)
    return CommandedPoses(arm, q, np.sign(np.diff(q, axis=0, prepend=0.0)), plan.time_s, plan.session, np.zeros(count))


def joint_load(count: int) -> JointLoad:
    return JointLoad(poses(count), RNG.normal(size=(count, 6)))


def test_worlds_have_names_of_their_own_and_stand_on_three_arms() -> None:
    assert len({case.name for case in BLIND_CASES}) == len(BLIND_CASES)
    assert {case.arm for case in BLIND_CASES} == {"lrm-lab", "so101-like", "ur5-like"}


def test_what_repeats_with_the_angle_or_the_time_repeats() -> None:
    load = joint_load(400)
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
    spot = GlareSpot(6, 0.003).link_deflection(EndLoad(poses(20), 6, np.zeros((20, 3)), force))
    np.testing.assert_allclose((spot[:, 3:] * force).sum(axis=1), 0.0, atol=1e-12)
    assert not spot[:, :3].any()


def test_foam_only_lifts_and_only_below_its_top() -> None:
    tcp = RNG.uniform(0.0, 0.5, (50, 3))
    error = FoamMat(0.2, 0.5).measurement_error(tcp)
    np.testing.assert_array_equal(error[:, 2] > 0.0, tcp[:, 2] < 0.2)
    assert not error[:, :2].any()


def test_what_slips_stays_where_it_slipped_to() -> None:
    load = joint_load(60)
    clutch = SlippingClutch(3, 1e9, 1.0).added_angles(load)
    assert not clutch.any()
    slipped = np.diff(SlippingClutch(3, 0.2, 0.01).added_angles(load)[:, 2])
    assert 0 < np.count_nonzero(slipped) < len(slipped)
    walked = WalkingBase(0.01, 1.0).link_deflection(EndLoad(load.poses, 0, np.zeros((60, 3)), np.zeros((60, 3))))
    wide = np.abs(np.diff(load.poses.q_rad[:, 0], prepend=0.0)) > 1.0
    np.testing.assert_array_equal(np.diff(walked[:, 2], prepend=0.0) != 0.0, wide)


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in BLIND_CASES if case.truths != ()], ids=lambda case: case.name)
def test_the_tip_errs_by_some_millimetres(case: Case) -> None:
    apart = dataset(case, 0, 120).tcp_m - dataset(replace(case, build=lambda *_: ()), 0, 120).tcp_m
    spread = np.sqrt(((apart - apart.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert 0.001 < spread < 0.0055
