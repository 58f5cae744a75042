"""Memory of friction along a campaign's path, against what the servos were sent, step by step."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.approach_path import states_from_beside
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurement_file.write import metadata_toml
from lrm_ident.measuring.campaign.rover_arm import APPROACH
from lrm_ident.measuring.campaign.servo_arm import ServoArm
from lrm_math.arm.arm import feasible_approach
from lrm_math.arrays import Array
from lrm_math.kinematics.motion import TRAVELS_DEG
from tests.ident.measuring.feetech.test_feetech_servos import ARM, WITHIN, BusLine, held, line_of, pose
from tests.support.sweep import examples

JOINTS = ARM.dof
SIDES = st.lists(st.sampled_from([-1, 1]), min_size=JOINTS, max_size=JOINTS)
"""Each joint's own, as `design` gives them: at a limit from within, whatever the side of the others."""
PLANS = st.lists(st.tuples(WITHIN, SIDES), min_size=2, max_size=5)
BETWEEN = np.array([0.9 * joint.upper for joint in ARM.joints])
"""(n,), rad: farther than any approach from 0, so the first move turns every joint one way."""


def driven(line: BusLine, plan: list[tuple[list[float], list[int]]]) -> tuple[Array, Array, Array]:
    """Commanded angles (N, n), sides (N, n), and friction states (N, n, K) along every target that was sent."""
    arm, q, sides, states = ServoArm(held(line), ARM, line, lambda _: None), [], [], []
    line.seen.clear()
    state = np.zeros((JOINTS, len(TRAVELS_DEG)))
    here = np.array([servo.target for servo in line.bus.servos])
    for goal, sides_to_come_from in [(BETWEEN.tolist(), [0] * JOINTS), *plan]:
        approach = feasible_approach(ARM, np.array(goal), np.array(sides_to_come_from))
        found = arm.go(replace(pose(goal), approach=tuple(approach.astype(int).tolist())))
        for there in np.array(line.seen):
            kept = np.exp(-np.abs(there - here)[:, None] / np.radians(TRAVELS_DEG))
            side = np.sign(there - here)[:, None]
            state, here = np.where(side == 0.0, state, side + kept * (state - side)), there
        line.seen.clear()
        q.append(found.q)
        sides.append(found.direction)
        state = np.repeat(np.array(sides[0], float)[:, None], len(TRAVELS_DEG), axis=1) if len(q) == 1 else state
        states.append(state)
    return np.array(q), np.array(sides, dtype=float), np.array(states)


@pytest.mark.long
@examples(4, 40)
@given(PLANS)
def test_states_are_those_along_all_that_was_sent(plan: list[tuple[list[float], list[int]]]) -> None:
    q, sides, states = driven(line_of(1, 2, 3, 4, 5), plan)
    found = states_from_beside(q, sides, ARM, APPROACH, np.zeros(len(q), dtype=bool))
    np.testing.assert_allclose(found, states, atol=0.1)  # a step of the encoder of the shortest travel


@pytest.mark.long
@examples(3, 20)
@given(PLANS, st.integers(1, 5))
def test_friction_turned_over_where_the_start_is_unknown(plan: list[tuple[list[float], list[int]]], row: int) -> None:
    q, sides, _ = driven(line_of(1, 2, 3, 4, 5), plan)
    begins = np.arange(len(q)) == min(row, len(q) - 1)
    found = states_from_beside(q, sides, ARM, APPROACH, begins)
    np.testing.assert_array_equal(found[begins], np.repeat(sides[begins][:, :, None], len(TRAVELS_DEG), axis=2))


def test_a_reader_uses_how_far_beside_the_poses_the_arm_came_from(tmp_path: Path) -> None:
    plan = [([0.5, 0.2, -0.3, 0.1, 1.0], [1] * JOINTS), ([0.1, 0.2, -0.6, 0.4, 0.0], [-1] * JOINTS)]
    q, sides, _ = driven(line_of(1, 2, 3, 4, 5), plan)
    names = [*(f"q{i + 1}_deg" for i in range(JOINTS)), "x_mm", "y_mm", "z_mm"]
    names += [f"approach{i + 1}" for i in range(JOINTS)]
    file, rows = tmp_path / "d.csv", np.column_stack([np.degrees(q), np.full((len(q), 3), 200.0), sides])
    np.savetxt(file, rows, "%.6f", ",", header=",".join(names), comments="")
    assert load_measurements(file, ARM).poses.friction is None
    stated = metadata_toml("so101", "test", start_q_deg=[0.0] * JOINTS, approach_deg=float(np.degrees(APPROACH)))
    file.with_suffix(".toml").write_text(stated)
    expected = states_from_beside(q, sides, ARM, APPROACH, np.zeros(len(q), dtype=bool))
    found = load_measurements(file, ARM).poses.friction
    np.testing.assert_allclose(found, expected, atol=1e-6)
