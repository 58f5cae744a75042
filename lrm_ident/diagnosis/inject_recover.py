"""Inject and recover: would these poses let the tool name what it is looking for?"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from zlib import crc32

import numpy as np

from lrm_ident.data.error_stats import figures
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.candidates import split_testable
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.effect_plugins import catalogue_with
from lrm_ident.fit.identifiability import fit_identifiable
from lrm_ident.progress import Tick, silent
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import Effect, effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model, model_of

SPREAD = 0.4  # of typical sizes, for the arm's own errors


@dataclass(frozen=True)
class Trial:
    """One effect injected at its typical size: what it does to the TCP (m RMS), and what was named.

    `named`: the first class, best first; empty if none. `verdict`: of the diagnosis, or an error.
    """

    truth: str
    moved: float
    verdict: str
    named: tuple[str, ...]

    @property
    def outcome(self) -> str:
        """found, one of a class, missed, or wrong."""
        if not self.named:
            return "missed"
        if self.truth not in self.named:
            return "wrong"
        return "found" if len(self.named) == 1 else "one of a class"


@dataclass(frozen=True)
class Plan:
    """What the poses can be tried on."""

    arm: str
    poses: Poses
    noise: float
    seed: int
    effects_file: Path | None


def may_show(plan: Plan, pattern: str = "*") -> tuple[list[str], list[tuple[Effect, str]]]:
    """Names of effects that the poses might show and that match the pattern; the others with the reason."""
    arm = load_arm(plan.arm)
    base = _base(arm)
    base = replace(base, free=tuple(base.keys))
    able, refused = split_testable(base, equilibrium(base, plan.poses), catalogue_with(plan.effects_file))
    names = [f"{effect.id}@{effect.place}" for effect, _ in able]
    return [name for name in names if fnmatchcase(name, pattern)], refused


def run(plan: Plan, names: Sequence[str], progress: Tick = silent) -> Iterator[Trial]:
    """Injects each effect and diagnoses, on all cores."""
    workers = min(len(names), os.cpu_count() or 1)
    with ProcessPoolExecutor(max(workers, 1), mp_context=multiprocessing.get_context("spawn")) as pool:
        waiting = [pool.submit(_trial, plan, name) for name in names]
        for done, future in enumerate(as_completed(waiting), start=1):
            progress(done, len(names))
            yield future.result()


def _base(arm: Arm) -> Model:
    return model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))


def _trial(plan: Plan, name: str) -> Trial:
    arm, catalogue = load_arm(plan.arm), catalogue_with(plan.effects_file)
    rng = np.random.default_rng([plan.seed, crc32(name.encode())])
    base = _base(arm)
    sizes = np.where([p.lower == 0.0 for p in base.parameters], rng.uniform(0.3, 1.0, len(base.keys)), 0.0)
    sizes += np.where([p.lower == 0.0 for p in base.parameters], 0.0, rng.normal(0, SPREAD, len(base.keys)))
    values = {k: s * p.typical for k, s, p in zip(base.keys, sizes, base.parameters, strict=True)}
    [effect] = effects_at(arm, name, catalogue)
    for parameter in effect.parameters:
        side = 1.0 if parameter.lower >= 0.0 else rng.choice([-1.0, 1.0])
        size = parameter.typical * side if parameter.fixed is None else parameter.fixed
        values[f"{effect.id}.{effect.place}.{parameter.name}"] = float(size)
    try:
        without = equilibrium(model_of(arm, base.effects, {k: values[k] for k in base.keys}), plan.poses).tcp
        truth = equilibrium(model_of(arm, (*base.effects, effect), values), plan.poses).tcp
        data = _measured(plan, truth + rng.normal(0, plan.noise, truth.shape))
        found = diagnose(fit_identifiable(base, data, base.keys).fit.model, data, catalogue)
    except LrmError as error:
        return Trial(name, float("nan"), str(error), ())
    moved = figures(truth - without).rms
    if found.verdict != "effect_missing":
        return Trial(name, moved, found.verdict, ())
    first = found.supported[0].name
    return Trial(name, moved, found.verdict, (first, *found.rivals[first]))


def _measured(plan: Plan, tcp: np.ndarray) -> Measurements:
    number = np.arange(1, len(tcp) + 1)
    return Measurements(plan.poses, number, tcp, None, plan.noise, number, Path("injected"), "")
