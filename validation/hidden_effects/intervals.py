"""Coverage of the confidence intervals of named effects: `python -m validation.hidden_effects.intervals` adds to each
data set of the first catalogue the effects that are hidden in it, and counts the intervals that hold the truth."""

from __future__ import annotations

import math
import warnings
from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import lrm_ident as lrm
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_math.arrays import Array
from lrm_math.effects import EffectRef, ParameterRef
from lrm_math.errors import LrmError
from validation.hidden_effects.case import ARM_FILE, Case
from validation.hidden_effects.cases import SINGLE
from validation.hidden_effects.data import dataset
from validation.interval_coverage import TWO_SIDED_95
from validation.options import Count, asked
from validation.runner import run_cases
from validation.synthetic import ArmDescription, Dataset, HiddenEffect, write
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

SPRINGS = ("joint2", "joint3", "joint4")
"""Joints whose compliance every case tells."""


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
                yield key, _z(fit, key, true)


def _z(fit: Fit, key: str, true: float) -> float:
    return (fit.model.value(key) - true) / float(fit.standard_error[fit.model.free.index(key)])


def deviations_of(case: Case, seed: int, count: int, folder: Path) -> Iterator[tuple[str, str, float]]:
    """Effect, key and z of each parameter within its bounds, of the hidden effects once added, and of springs."""
    made = dataset(case, seed, count)
    study = lrm.Study.of(lrm.load(write(folder / case.name, made, "coverage of intervals")[0], ARM_FILE)).fit()
    for name in case.truth or ():
        study = study.add(name)
    fitted = study.taken.fit
    for key, z in deviations(fitted, made):
        if key not in fitted.at_bound:
            yield ParameterRef.parse(key).id, key, z
    beside = f"springs beside {EffectRef.parse((case.truth or ('nothing',))[0]).id}"
    for joint in SPRINGS:
        key = f"compliance.{joint}.k_rad_per_Nm"
        if key in fitted.model.free and key not in fitted.at_bound:
            yield beside, key, _z(fitted, key, made.truth.joint_compliance_rad_per_nm[int(joint[-1]) - 1])


def examine(poses: int, which: tuple[str, int]) -> list[tuple[str, str, float]] | str:
    """`deviations_of` a case by its name and a seed, or why there are none."""
    name, seed = which
    warnings.simplefilter("ignore")
    with TemporaryDirectory() as folder:
        try:
            return list(deviations_of(SINGLE[name], seed, poses, Path(folder)))
        except LrmError as error:
            return str(error)


def line(key: str, found: list[tuple[str, str, float]] | str) -> str:
    """One data set."""
    return f"{key}: {found if isinstance(found, str) else ' '.join(f'{of} {z:+.1f}' for _, of, z in found)}"


def main() -> None:
    """Prints the share by effect."""
    options = asked(
        __doc__,
        seeds=Count(3),
        first=(0, "first seed"),
        poses=Count(150),
        only=("", "cases whose name contains this"),
        jobs=1,
    )
    seeds = range(options.first, options.first + options.seeds)
    cases = {f"{seed} {name}": (name, seed) for seed in seeds for name in SINGLE if options.only in name}
    found = defaultdict[str, list[float]](list)
    for rows in run_cases(cases, partial(examine, options.poses), line, options.jobs).values():
        for effect, _, z in () if isinstance(rows, str) else rows:
            found[effect].append(z)
    for effect, every in sorted(found.items()):
        held = f"{(np.abs(every) < TWO_SIDED_95).sum()} of {len(every)} hold the truth"
        print(f"{effect}: {held}; RMS of z {np.sqrt(np.mean(np.square(every))):.2f}")
    everything = np.concatenate(list(found.values()))
    print(f"all: {100 * np.mean(np.abs(everything) < TWO_SIDED_95):.1f} % of {len(everything)}")


if __name__ == "__main__":
    main()
