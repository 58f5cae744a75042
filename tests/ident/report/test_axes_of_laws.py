"""An effect is drawn against what its law follows, and a compliance is told as the angle of the usual load."""

from __future__ import annotations

import numpy as np
import pytest

from lrm_ident.report.text.claims import in_words, stated
from lrm_ident.report.text.variables import variable_name
from lrm_ident.residual.covariates import Covariate, Kind
from lrm_ident.residual.gravity_loads import LOCAL, local_covariates, usual_turns
from lrm_ident.residual.picture.group_means import of_law
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

KINDS: tuple[Kind, ...] = ("angle", "motion")


@pytest.mark.parametrize(
    ("name", "axes"),
    [
        ("hysteresis@joint3", ["last motion of joint 3"]),
        ("backlash@joint2", ["torque of joint 2"]),
        ("friction_curve@joint2", ["last motion of joint 2", "torque of joint 2"]),
        ("servo_gain@joint1", ["angle of joint 1"]),
        ("cable_curve@joint1+joint2", ["angle of joint 1", "angle of joint 2"]),
        ("coupling_curve@joint2<-joint3", ["angle of joint 3"]),
        ("drift@base", ["order of measurement"]),
        ("compliance@joint2", ["torque of joint 2"]),
        ("base_curve@base", [f"moment on the base about {axis}" for axis in "xyz"]),
        ("lateral_compliance@link2", ["moment on link 2 about its x", "moment on link 2 about its y"]),
        ("bearing_curve@link2", ["moment on link 2 about its x", "moment on link 2 about its y"]),
        ("depth_scale@frame", ["x of the tip", "y of the tip", "z of the tip"]),
        ("axial_play@joint2", ["force along the axis of joint 2"]),
    ],
)
def test_the_abscissa_is_that_of_the_law(lab: Arm, name: str, axes: list[str]) -> None:
    """Before: effects of base and links were drawn against the torques of joints."""
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (9, 6))
    rest = solve_equilibrium(model_of(lab, ()), poses_of(q, 0.1))
    known = [Covariate(kind, q.T[joint], joint) for kind in KINDS for joint in range(6)]
    torques = (
        Covariate("torque", torque, joint, f"joint{joint + 1}.theta")
        for joint, torque in enumerate(rest.joint_torque.T)
    )
    known += [*torques, Covariate("order", np.zeros(3)), *local_covariates(rest)]
    (effect,) = effects_at(lab, name)
    assert [variable_name(one.variable) for one in of_law(effect, known)] == axes
    (mass,) = effects_at(lab, "mass@link5")
    assert {"order", *LOCAL}.isdisjoint(one.kind for one in of_law(mass, known))


@pytest.mark.parametrize(
    ("name", "value", "power"), [("compliance@joint2", 0.05, 1), ("nonlinear_stiffness@joint2", 0.3, 2)]
)
def test_a_compliance_is_the_angle_of_the_usual_load(lab: Arm, name: str, value: float, power: int) -> None:
    """Before: 0.05 rad/Nm, which tells a layman nothing."""
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (9, 6))
    rest = solve_equilibrium(model_of(lab, ()), poses_of(q, 0.1))
    (effect,) = effects_at(lab, name)
    turns = usual_turns(effect, rest)
    load = np.sqrt(np.mean(rest.joint_torque[:, 1] ** 2))
    first = effect.parameters[0]
    assert turns[first.name] == pytest.approx(load**power)
    words = {p.name: in_words(p, value, 0.1 * value, turns[p.name]) for p in effect.parameters}
    angle = np.degrees(value * load**power)
    assert words[first.name].startswith(f"{angle:.3g}"[:3])
    assert words[first.name].endswith("°")
    assert stated(effect, words, turns).endswith("under the usual load")


def test_round_off_is_no_load() -> None:
    """Gravity does not turn a joint whose axis is vertical: its compliance keeps rad/Nm."""
    arm, q = load_arm("so101"), np.random.default_rng(0).uniform(-1.0, 1.0, (9, 5))
    rest = solve_equilibrium(model_of(arm, effects_at(arm, "compliance@joint2")), poses_of(q, 0.1))
    assert np.abs(rest.joint_torque[:, 0]).max() < 1e-9 < np.abs(rest.joint_torque[:, 1]).max()
    assert usual_turns(effects_at(arm, "compliance@joint1")[0], rest) == {}
