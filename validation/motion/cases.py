"""Cases of hidden motion: 12 causes of the catalogue, 3 arms without any, 4 causes that the catalogue lacks.

Those of `FIRST` were written before the tool had been tried on any case, those of `LATER` after it was done, unseen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from lrm_math.effects import ParameterRef
from validation.motion.world import JOINTS, TrueJoints
from validation.synthetic.screws import Array


@dataclass(frozen=True)
class MotionCase:
    """A hidden cause.

    Attributes:
        name: of the case. hide: changes the joints of an arm at one joint. joints: where it may hide, from 0.
        true: ids of effects that are right names of it; none for what the catalogue lacks, and for an arm without any.
        known: id of the effect, its parameter, and where its true value (SI) is read back from the arm.
    """

    name: str
    hide: Callable[[TrueJoints, int, np.random.Generator], None]
    joints: tuple[int, ...] = (0, 1, 2, 3, 4)
    true: tuple[str, ...] = ()
    known: tuple[tuple[str, str, str], ...] = ()


def _put(name: str, low: float, high: float) -> Callable[[TrueJoints, int, np.random.Generator], None]:
    def hide(arm: TrueJoints, joint: int, rng: np.random.Generator) -> None:
        getattr(arm, name)[joint] = np.exp(rng.uniform(np.log(low), np.log(high)))

    return hide


def _linked(arm: TrueJoints, joint: int, rng: np.random.Generator) -> None:
    arm.link_share[joint] = rng.uniform(0.35, 0.6)


def _stick_slip(arm: TrueJoints, joint: int, rng: np.random.Generator) -> None:
    arm.friction[joint], arm.stiction[joint] = rng.uniform(0.008, 0.015), rng.uniform(0.015, 0.03)
    arm.stiction_speed[joint] = rng.uniform(0.1, 0.25)


def _swing(arm: TrueJoints, joint: int, rng: np.random.Generator) -> None:
    arm.second_hz[joint], arm.second_damping[joint] = rng.uniform(3.0, 7.0), rng.uniform(0.03, 0.12)


def _nothing(arm: TrueJoints, joint: int, rng: np.random.Generator) -> None:
    pass


FIRST = (
    MotionCase(
        "dead time", _put("dead_time", 0.02, 0.08), true=("dead_time",), known=(("dead_time", "t_s", "dead_time"),),
    ),
    MotionCase(
        "speed limit", _put("speed", 0.6, 1.5), true=("speed_limit",), known=(("speed_limit", "v_rad_per_s", "speed"),),
    ),
    MotionCase(
        "gravity sag", _put("compliance", 0.02, 0.06), (1, 2), ("gravity_sag", "inertial_coupling", "link_inertia"),
        (("gravity_sag", "k_rad_per_Nm", "compliance"),),
    ),
    MotionCase(
        "coulomb friction", _put("friction", 0.006, 0.03), true=("coulomb_friction",),
        known=(("coulomb_friction", "c_rad", "friction"),),
    ),
    MotionCase("play", _put("play", 0.01, 0.05), true=("motion_play",), known=(("motion_play", "b_rad", "play"),)),
    MotionCase(
        "swing", _swing, true=("swing",),
        known=(("swing", "frequency_Hz", "second_hz"), ("swing", "damping_ratio", "second_damping")),
    ),
    MotionCase("nothing", _nothing),
    MotionCase("nothing, again", _nothing),
    MotionCase("integral action", _put("integral_s", 0.5, 1.5)),
    MotionCase("cogging", _put("cogging", 0.01, 0.02)),
)  # fmt: skip
LATER = (
    MotionCase(
        "acceleration limit", _put("acceleration", 5.0, 15.0), true=("acceleration_limit",),
        known=(("acceleration_limit", "a_rad_per_s2", "acceleration"),),
    ),
    MotionCase(
        "saturated drive", _put("drive", 0.05, 0.12), true=("drive_limit",), known=(("drive_limit", "e_rad", "drive"),)
    ),
    MotionCase(
        "velocity feedforward", _put("lead", 0.02, 0.06), true=("velocity_feedforward",),
        known=(("velocity_feedforward", "t_s", "lead"),),
    ),
    MotionCase("links heavier than the motor", _linked, (1, 2), ("gravity_sag", "inertial_coupling", "link_inertia")),
    MotionCase(
        "load friction", _put("load_friction", 0.02, 0.06), (1, 2), ("load_friction",),
        (("load_friction", "m_rad_per_Nm", "load_friction"),),
    ),
    MotionCase("stick-slip", _stick_slip, true=("stribeck", "coulomb_friction")),
    MotionCase("nothing, later", _nothing),
    MotionCase("drag with the square of speed", _put("drag", 0.01, 0.03)),
    MotionCase("slowing as it warms", _put("slowing", 0.3, 0.6)),
)  # fmt: skip


def arm_of(case: MotionCase, rng: np.random.Generator, count: int = JOINTS) -> tuple[TrueJoints, int]:
    """An arm of so many joints, sound but for the cause, and the joint where it is, from 0."""
    arm = TrueJoints.of(count)
    arm.frequency_hz, arm.damping = rng.uniform(3.0, 6.0, count), rng.uniform(0.6, 1.2, count)
    arm.offset = np.radians(rng.uniform(-1.0, 1.0, count))
    joint = int(rng.choice(case.joints))
    case.hide(arm, joint, rng)
    return replace(arm), joint


def truth_of(case: MotionCase, arm: TrueJoints, joint: int) -> dict[str, float]:
    """True values (SI) by key `id.jointN.parameter`, those of the servo included where the cause leaves them so."""
    values: dict[str, Array] = {f.name: getattr(arm, f.name) for f in fields(TrueJoints)}
    out = {
        str(ParameterRef(kind, f"joint{joint + 1}", parameter)): float(values[of][joint])
        for kind, parameter, of in case.known
    }
    for number in range(len(arm.offset)):
        place = f"joint{number + 1}"
        if number != joint or case.true:
            out[f"servo_response.{place}.frequency_Hz"] = float(arm.frequency_hz[number])
            out[f"servo_response.{place}.damping_ratio"] = float(arm.damping[number])
            out[f"rest_offset.{place}.b_rad"] = float(arm.offset[number])
    return out
