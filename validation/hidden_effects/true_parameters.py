"""True values of the parameters that a hidden effect makes, and how far their estimates are from them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_math.arrays import Array
from validation.synthetic import ArmDescription, Dataset, HiddenEffect
from validation.synthetic.hidden_bodies import WrongBody, WrongLoad
from validation.synthetic.hidden_joints import CoupledJoint, EccentricShaft, FastClock, OneSidedGain, SoftPlay
from validation.synthetic.hidden_links import BaseRocking, BaseWarmUp, ViscoelasticBase
from validation.synthetic.hidden_memory import (
    FrictionLag,
    HeatedServo,
    JointSlip,
    PromptReading,
    SessionStep,
    SlippingHorn,
    ViscoelasticJoint,
    WarmUp,
)
from validation.synthetic.hidden_tracker import SkewTracker


def true_parameters(hidden: HiddenEffect, arm: ArmDescription, q: Array) -> dict[str, float]:
    """The tool's parameters, by key, that a hidden effect makes (SI), as far as its formula has a counterpart.

    `q`: (P, N), measured angles (rad): a bent law has the line that is nearest to it there.
    """
    match hidden:
        case SoftPlay(joint, width):
            return {f"backlash.joint{joint}.b_rad": width}
        case OneSidedGain(joint, side, gain):
            plus = gain if side > 0 else 0.0
            return {
                f"servo_gain.joint{joint}.g_plus_rad_per_rad": plus,
                f"servo_gain.joint{joint}.g_minus_rad_per_rad": gain - plus,
            }
        case FastClock(part):
            return {"common_gain.servos.g_rad_per_rad": part}
        case EccentricShaft(joint, offset, phase):
            return _waves(joint, offset, phase)
        case FrictionLag(joint, width):
            return {f"hysteresis.joint{joint}.h_rad": -width}
        case CoupledJoint(joint, by, ratio, bend):
            slope = float(np.polyfit(q[:, by - 1], ratio * bend * np.sin(q[:, by - 1] / bend), 1)[0])
            return {f"coupling.joint{joint}<-joint{by}.c_rad_per_rad": slope}
        case BaseRocking(compliance):
            return {"base_compliance.base.k_x_rad_per_Nm": compliance}
        case WrongLoad(extra, _):
            return {"payload.tool.mass_g": extra}
        case WrongBody(body, share, _):
            [mass] = [one.mass_kg for one in arm.bodies if one.name == body]
            return {f"mass.{body.replace(' ', '')}.mass_g": share * mass}
        case WarmUp(joint, final):
            return {f"drift.joint{joint}.A_rad": final}
        case BaseWarmUp((_, about_y, _)):
            return {"drift.base.A_beta_rad": about_y}
        case JointSlip(joint, size):
            return {f"change_point.joint{joint}.before_rad": -size}
        case SessionStep(joint, steps):
            return {f"session.joint{joint}.step{i}_rad": step for i, step in enumerate(steps[1:], start=2)}
        case SkewTracker():
            return _stretch(np.eye(3) + hidden.measurement_error(np.eye(3) + hidden.centre_m).T)
        case ViscoelasticJoint(joint, compliance, (_,)) | PromptReading(joint, compliance):
            return {f"creep.joint{joint}.k_rad_per_Nm": compliance}
        case ViscoelasticBase((about_x, about_y)):
            return {"creep.base.k_x_rad_per_Nm": about_x, "creep.base.k_y_rad_per_Nm": about_y}
        case HeatedServo(joint, zero, scale):
            names = {"a_rad_per_Nm2": zero, "g_rad_per_rad_per_Nm2": scale}
            return {f"self_heating.joint{joint}.{name}": value for name, value in names.items()}
        case SlippingHorn(joint, bound):
            return {f"slip.joint{joint}.b_rad": bound}
        case _:
            return {}


def _stretch(seen: Array) -> dict[str, float]:
    """Symmetric part of an affine map (3, 3), the rigid turn of the base taken off (left polar decomposition)."""
    squares, axes = np.linalg.eigh(seen @ seen.T)
    change = axes @ np.diag(np.sqrt(squares)) @ axes.T - np.eye(3)
    names = {f"scale_{x}": change[i, i] for i, x in enumerate("xyz")}
    names |= {f"shear_{'xyz'[i]}{'xyz'[j]}": change[i, j] for i, j in ((0, 1), (0, 2), (1, 2))}
    return {f"measurement_frame.frame.{name}_mm_per_m": float(value) for name, value in names.items()}


def _waves(joint: int, offset: float, phase: float) -> dict[str, float]:
    """First two waves of an eccentric shaft: Σ offsetⁿ/n sin n(q − phase), less that at zero, and a sign."""
    found = {}
    for n in (1, 2):
        size = -(offset**n) / n
        found[f"eccentricity.joint{joint}.a{n}_rad"] = -size * math.cos(n * phase)
        found[f"eccentricity.joint{joint}.b{n}_rad"] = size * math.sin(n * phase)
    return found


def deviations(fit: Fit, made: Dataset) -> Iterator[tuple[str, float]]:
    """Key and (estimate − truth) / standard error of each parameter of the hidden effects that was fitted freely."""
    for effect in made.truth.effects:
        for key, true in true_parameters(effect, made.arm, made.q_rad).items():
            if key in fit.model.free:
                yield key, (fit.model.value(key) - true) / float(fit.standard_error[fit.model.free.index(key)])
