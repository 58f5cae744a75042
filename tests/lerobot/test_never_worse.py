"""The tip is never worse with the correction than without it, by more than 5 %: near goals, singular ones, any."""

from __future__ import annotations

import numpy as np
import pytest

from lerobot_robot_lrm.correction import REVERSAL, Correction
from lerobot_robot_lrm.least_deviation import GAIN
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.motion import Motion
from lrm_math.model.model import model_of
from tests.support.lerobot.rests import lagging_model, rests, tip
from tests.support.sweep import seeds

ARM = load_arm("so101")
LEAD = 0.03


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(1, 4))
def test_corrected_is_not_worse_than_uncorrected_at_any_goal(seed: int) -> None:
    made = Correction.of(lagging_model(ARM, np.random.default_rng([2, seed])))
    found = list(rests(made, seed, 12))
    assert len(found) > 6
    for each in found:
        assert not each.worse, each


@pytest.mark.parametrize("share", np.linspace(0.05, 0.95, 7))
def test_a_joint_that_leads_after_a_turn_stands_at_the_nearer_of_both_sides(share: float) -> None:
    """Between its two sides it cannot stand after one move; what is left is half of the lead, not all of it."""
    model = model_of(ARM, effects_at(ARM, "hysteresis@joint3"), {"hysteresis.joint3.h_rad": LEAD})
    made = Correction.of(model)
    came = Motion.at(np.zeros(ARM.dof)).to(np.full(ARM.dof, 0.3))
    wish = came.q.copy()
    wish[2] += 0.5 * LEAD - share * LEAD
    sent = came.to(made.command(wish, came))
    stands = made.arm.settled(sent.q, sent)[made.arm.joints] - made.drawn.slots_at(wish)[made.drawn.joints]
    assert np.abs(stands).max() <= min(share, 1.0 - share) * LEAD + REVERSAL + 1e-6
    again = made.command(wish, sent)
    np.testing.assert_allclose(again, sent.q, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(1, 6))
def test_joints_within_their_limits_make_up_for_one_that_ends_at_its_own(seed: int) -> None:
    """Joint 2 would have to be commanded beyond its limit: the tip stays nearer than with this command clipped alone,
    nearer than without correction, and the answer is continuous on the way to the limit."""
    rng = np.random.default_rng([65, 7, seed])
    made = Correction.of(model_of(ARM, effects_at(ARM, "offsets@joint2"), {"offsets.joint2.theta_rad": -0.06}))
    low, high = made.limits
    wish = 0.6 * rng.uniform(low, high)
    came = Motion.at(wish)
    answers = []
    for shift in np.linspace(0.12, 0.0, 241):
        wish[1] = high[1] - shift
        answers.append(made.command(wish, came))
    assert answers[-1][1] == high[1]
    assert np.abs(np.diff(answers, axis=0)).max() < (1.0 + GAIN) * 0.12 / 240
    goal = tip(made, wish, None)
    alone = wish.copy()
    alone[1] = high[1]
    clipped = float(np.linalg.norm(tip(made, alone, Motion.at(alone)) - goal))
    left = float(np.linalg.norm(tip(made, answers[-1], Motion.at(answers[-1])) - goal))
    assert left < 0.9 * clipped
