"""Recordings that count from other zeros than the arm's file are read rightly, by every door that reads them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.data.registration.zero_conventions import EXTENDED, convention_of
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from tests.ident.measuring.recordings.test_lerobot import written
from tests.support.commands import run_command
from tests.support.sweep import examples

SO_ARMS = ("so100", "so101", "lekiwi")


def poses_of(arm: Arm, seed: int, rests: int = 20) -> Array:
    """Poses (rests, n), rad, of a teleoperated arm: folded back, at least at one of them."""
    low, high = np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    poses = np.random.default_rng(seed).uniform(0.9 * low, 0.9 * high, (rests, arm.dof))
    poses[0, 1:3] = 0.95 * low[1], 0.95 * high[2]
    return poses


def as_before(angles: Array) -> Array:
    """Angles as LeRobot recorded them before June 2025: new lift = 90 deg - old, new elbow = old - 90 deg."""
    old = angles.copy()
    old[:, 1], old[:, 2] = np.pi / 2.0 - angles[:, 1], angles[:, 2] + np.pi / 2.0
    return old


def drawn_elsewhere(arm: Arm, zeros: Array) -> Arm:
    """The same arm, its file counting from other zeros (n,), rad: those of a URDF."""
    moved = [
        replace(joint, theta=joint.theta - zero, lower=joint.lower + zero, upper=joint.upper + zero)
        for joint, zero in zip(arm.joints, zeros.tolist(), strict=True)
    ]
    return replace(arm, joints=tuple(moved))


@examples(10, 20)
@given(st.integers(0, 10**6), st.sampled_from(SO_ARMS))
def test_old_zeros_are_read_as_new_ones_and_new_ones_stay(seed: int, name: str) -> None:
    arm = load_arm(name)
    poses = poses_of(arm, seed)
    assert convention_of(arm, poses) is None
    rule = convention_of(arm, as_before(poses))
    np.testing.assert_allclose(rule.applied(as_before(poses)), poses, atol=1e-12)


@examples(10, 20)
@given(st.integers(0, 10**6), st.sampled_from(SO_ARMS))
def test_the_middles_of_the_ranges_are_found_for_an_arm_drawn_elsewhere(seed: int, name: str) -> None:
    arm = load_arm(name)
    ends = np.array([(joint.lower, joint.upper) for joint in arm.joints])
    zeros = np.array([0.0, 1.75, -1.57, -0.65, 0.0])
    elsewhere = drawn_elsewhere(arm, zeros)
    poses = poses_of(arm, seed)
    centred = poses - np.where(np.ptp(ends, axis=1) < 6.2, ends.mean(axis=1), 0.0)
    for recorded in (centred, as_before(centred)):
        rule = convention_of(elsewhere, recorded)
        np.testing.assert_allclose(rule.applied(recorded), poses + zeros, atol=1e-12)
    assert convention_of(elsewhere, poses + zeros) is None


def test_an_arm_of_other_names_has_no_old_zeros() -> None:
    arm = load_arm("ur5")
    assert convention_of(arm, np.full((1, 6), 7.5 * np.pi)) is None
    assert not {*EXTENDED} & {str(joint.name) for joint in arm.joints}


@pytest.mark.parametrize("door", ["import", "checkup"])
@pytest.mark.parametrize("name", SO_ARMS)
def test_every_door_reads_old_zeros_and_prints_the_rule(door: str, name: str, tmp_path: Path) -> None:
    arm = load_arm(name)
    poses = np.degrees(as_before(poses_of(arm, 3)))
    folder, out = written(tmp_path / "dataset", poses, np.zeros_like(poses)), tmp_path / "poses.csv"
    words = ("import", "lerobot", folder, "-o", out) if door == "import" else ("checkup", folder)
    code, said, err = run_command(*words, "--arm", name)
    assert code == 0, err
    told = re.sub(r"\s+", " ", err)
    assert (
        "(LeRobot before June 2025): read so (shoulder_lift = -recorded +90 deg, elbow_flex = recorded -90 deg)" in told
    )
    assert "beyond its limits" not in said
    if door == "import":
        np.testing.assert_allclose(load_poses(out, arm).q, poses_of(arm, 3), atol=3e-4)
