"""The simulated arm's joints creep: the deflection follows the load of a standing arm, and comes back."""

from __future__ import annotations

import math

import pytest

from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError, UnknownName
from lrm_math.model.model import model_of
from lrmd.config import SECOND
from lrmd.sim.arm import SimulatedArm
from lrmd.sim.creep import CreepingJoints, JointCreep
from lrmd.sim.pca9685_chip import Pca9685Chip
from lrmd.sim.process import creeps_of

ARM = load_arm("lrm-rover")
CHANNELS = {name: channel for channel, name in enumerate(ARM.joint_names)}


def test_a_standing_arm_sinks_by_its_load() -> None:
    """Its servos have no pulses: they come to rest first."""
    creep = JointCreep(0.02, 40.0)
    arm = SimulatedArm(model_of(ARM, ()), CHANNELS, [0.0, 0.8, 0.0, 0.0, 0.0, 0.0], creeps={"joint2": creep})
    chip = Pca9685Chip(25e6)
    for second in range(0, 600, 2):
        arm.advance(chip, second * SECOND)
    due = creep.compliance * arm.equilibrium().joint_torque[-1, 1]
    assert arm.link_angles[1] - arm.q[1] == pytest.approx(due, rel=1e-3)
    assert abs(due) > 1e-3
    assert not arm.moving


def test_creep_comes_back_and_the_steps_of_time_do_not_matter() -> None:
    one, many = (CreepingJoints(["joint1"], {"joint1": JointCreep(0.1, 30.0)}) for _ in range(2))
    for torque in (2.0, 0.0):
        one.yield_to([torque], 50.0)
        for _ in range(500):
            many.yield_to([torque], 0.1)
        assert one.deflection == pytest.approx(many.deflection)
    assert 0.0 < one.deflection[0] < 0.2 * math.exp(-50.0 / 30.0)


def test_bad_creeps_are_refused() -> None:
    assert creeps_of(["joint2=0.05:60"]) == {"joint2": JointCreep(0.05, 60.0)}
    for text in ("joint2=0.05", "joint2=a:b", "joint2=0.05:0", "joint2=-1:5"):
        with pytest.raises(LrmError, match="creep"):
            creeps_of([text])
    with pytest.raises(UnknownName, match="joint9"):
        CreepingJoints(ARM.joint_names, creeps_of(["joint9=0.05:60"]))
