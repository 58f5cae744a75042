"""Inject and recover: each effect is simulated at planned poses, and the diagnosis has to name it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from zlib import crc32

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.diagnosis.screening.candidates import Refusal, split_testable, unfitted_effects
from lrm_ident.fitting.effect_plugins import catalogue_with
from lrm_ident.fitting.executors import as_finished
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

NOMINAL_SD = 0.4  # of the arm's other errors, in typical sizes


@dataclass(frozen=True)
class InjectionTrial:
    """One effect injected at its typical size.

    Attributes:
        truth: the effect, `effect@place`. moved: RMS motion of the TCP that it causes (m).
        verdict: of the diagnosis; None where it failed. error: why it did.
        named: the first supported effect and those equivalent to it; empty if none.
    """

    truth: str
    moved: float
    verdict: Verdict | None
    named: tuple[str, ...] = ()
    error: str = ""

    @property
    def outcome(self) -> str:
        """`found`, `one of a class`, `missed`, `wrong` or `failed`."""
        if self.verdict is None:
            return "failed"
        if not self.named:
            return "missed"
        if self.truth not in self.named:
            return "wrong"
        return "found" if len(self.named) == 1 else "one of a class"


@dataclass(frozen=True)
class InjectionPlan:
    """The poses to try, the noise (m per axis) and the seed of the simulation."""

    arm: str
    poses: Poses
    noise: float
    seed: int
    effects_file: Path | None


def detectable_effects(plan: InjectionPlan, pattern: str = "*") -> tuple[list[str], list[Refusal]]:
    """Names of the effects that the poses can test and that match a pattern; the untestable effects with the reason."""
    base = nominal_model(load_arm(plan.arm))
    base = base.with_free(base.keys)
    effects = unfitted_effects(base, catalogue_with(plan.effects_file))
    plain = [(effect, rows) for effect, rows in effects if not effect.is_free_form]
    testable, not_testable = split_testable(plain, solve_equilibrium(base, plan.poses))
    names = [effect.name for effect, _ in testable]
    return [name for name in names if fnmatchcase(name, pattern)], not_testable


def run_trials(
    plan: InjectionPlan, names: Sequence[str], executor: Executor, progress: OnProgress = silent
) -> Iterator[InjectionTrial]:
    """Trials of the effects in parallel, as they finish."""
    for _, trial in as_finished(executor, partial(_trial, plan, load_arm(plan.arm)), names, progress):
        yield trial


def _trial(plan: InjectionPlan, arm: Arm, name: str) -> InjectionTrial:
    """Simulates an arm of random errors with one effect of typical size, fits and diagnoses it."""
    catalogue = catalogue_with(plan.effects_file)
    rng = np.random.default_rng([plan.seed, crc32(name.encode())])
    base = nominal_model(arm)
    positive, count = [p.lower == 0.0 for p in base.parameters], len(base.keys)
    sizes = np.where(positive, rng.uniform(0.3, 1.0, count), rng.normal(0, NOMINAL_SD, count))
    values = {k: s * p.typical for k, s, p in zip(base.keys, sizes, base.parameters, strict=True)}
    [effect] = effects_at(arm, name, catalogue)
    for key, parameter in zip(effect.keys, effect.parameters, strict=True):
        sign = 1.0 if parameter.lower >= 0.0 else rng.choice([-1.0, 1.0])
        size = parameter.typical * sign if parameter.fixed is None else parameter.fixed
        values[key] = float(size)
    try:
        without = solve_equilibrium(model_of(arm, base.effects, {k: values[k] for k in base.keys}), plan.poses).tcp
        truth = solve_equilibrium(model_of(arm, (*base.effects, effect), values), plan.poses).tcp
        tcp = truth + rng.normal(0, plan.noise, truth.shape)
        data = Measurements.of_tcp(plan.poses, tcp, plan.noise)
        diagnosis = diagnose(fit_identifiable(base, data, base.keys).fit.model, data, catalogue)
    except LrmError as error:
        return InjectionTrial(name, float("nan"), None, error=str(error))
    first = [candidate.name for candidate in diagnosis.supported[:1] if diagnosis.verdict == Verdict.EFFECT_MISSING]
    named = tuple(name for effect in first for name in (effect, *diagnosis.equivalent[effect]))
    return InjectionTrial(name, error_stats(truth - without).rms, diagnosis.verdict, named)
