"""`python -m validation.real_data.implanted --rig measurements.csv`: an effect of known size in real measurements.

To each measured position is added what the effect moves the tip of the fitted arm, 2 to 6 times the RMS error of that
fit. So the error of a real arm stays beside the effect. `--keep` leaves the files, for another version of the tool.
"""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import lrm_ident as lrm
from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.write import measurements_csv, write_with_metadata
from lrm_ident.diagnosis.attribution import term_of
from lrm_ident.diagnosis.auto import AutoRun
from lrm_ident.residual.better_prediction import vuong_z
from lrm_math.arrays import Array
from lrm_math.effects import EffectRef
from validation.interval_coverage import TWO_SIDED_95
from validation.options import Count, asked
from validation.real_data.__main__ import SOURCES
from validation.real_data.grids import GridSource
from validation.real_data.implant import RealArm, drawn
from validation.real_data.sources import NotReachable
from validation.runner import ResultsFile, run_cases
from validation.tables import Column, counted, share, spread, table

ABSORBED_Z = 2.0
NOT_FOUND = ("a free curve there", "vanished")
REACHED = ("identified cause", "indistinguishable cause", "candidate cause", "empirical term", *NOT_FOUND)


@dataclass(frozen=True)
class Found:
    """What `auto` names where an effect is there.

    Attributes:
        effect: what was put in. size: RMS motion over the RMS error of the plain fit.
        raised: held-out RMS of the plain fit over that without the effect. absorbed: by it; then that is all.
        steps: each step's effect and its class. forms: of what each is another form. terms: what each is called.
        ratio: held-out RMS of `auto` over that without the effect. z: (estimate − truth) / standard error.
    """

    effect: str
    size: float
    raised: float
    absorbed: bool = False
    steps: tuple[tuple[str, ...], ...] = ()
    forms: tuple[tuple[str, ...], ...] = ()
    terms: tuple[str, ...] = ()
    ratio: float | None = None
    z: tuple[float, ...] = ()

    @property
    def reached(self) -> str:
        """The most that is said of it, one of `REACHED`."""
        terms = [term for step, term in zip(self.steps, self.terms, strict=True) if self.effect in step]
        curves = [step[0] for step, forms in zip(self.steps, self.forms, strict=True) if forms]
        form = any(joints(self.effect) & joints(curve) for curve in curves)
        return min(terms, key=REACHED.index, default=NOT_FOUND[0 if form else 1])

    @property
    def first(self) -> bool:
        """Whether the first step is it, or has it in its class."""
        return self.effect in (self.steps[0] if self.steps else ())

    @property
    def false(self) -> tuple[str, ...]:
        """Other effects that are called identified."""
        named = zip(self.steps, self.terms, strict=True)
        return tuple(step[0] for step, term in named if self.effect not in step and REACHED.index(term) < 2)


def joints(effect: str) -> set[str]:
    """Joints and links at which an effect acts."""
    return set(re.findall(r"[a-z]+\d+", EffectRef.parse(effect).place))


def examine(arms: Mapping[str, RealArm], keep: Path | None, which: tuple[str, int]) -> Found:
    """One effect in the measurements of an arm, by the arm's key and a seed."""
    key, seed = which
    arm = arms[key]
    effect, values, moved = drawn(arm, seed)
    with TemporaryDirectory() as scratch:
        path = (keep or Path(scratch)) / f"{key}-{seed}.csv"
        stated = ", ".join(f"{name} {value:.9g}" for name, value in zip(effect.keys, values, strict=True))
        write_with_metadata(path, measurements_csv(arm.data.with_tcp(arm.data.tcp + moved)), arm.name, stated)
        study = lrm.Study.of(lrm.load(path)).fit()
    plain = Found(effect.name, error_stats(moved).rms / arm.fit_rms, _rms(study) / _rms(arm.fitted))
    if vuong_z(_squared(study) - _squared(arm.fitted)) < ABSORBED_Z:
        return replace(plain, absorbed=True)
    run, after = study.auto()
    return replace(judged(plain, run, dict(zip(effect.keys, values, strict=True))), ratio=_rms(after) / _rms(arm.after))


def judged(plain: Found, run: AutoRun, truth: Mapping[str, float]) -> Found:
    """What a run says of the effect that was put in; `truth`: its parameters (SI) by key."""
    steps, fit = run.steps[1:], run.steps[-1].fit
    errors = dict(zip(fit.model.free, fit.standard_error.tolist(), strict=True))
    shown = zip(steps, run.attributions, strict=True)
    return replace(
        plain,
        steps=tuple((step.added, *step.evidence.equivalent) for step in steps),
        forms=tuple(step.evidence.refines for step in steps),
        terms=tuple(str(term_of(one.kind, step.evidence.equivalent)) for step, one in shown),
        z=tuple((fit.model.value(key) - true) / errors[key] for key, true in truth.items() if key in errors),
    )


def _left(study: lrm.Study) -> Array:
    residual = study.held_out.residual
    assert residual is not None, study.held_out.reason
    return residual


def _rms(study: lrm.Study) -> float:
    return error_stats(_left(study)).rms


def _squared(study: lrm.Study) -> Array:
    return np.asarray((_left(study) ** 2).sum(axis=1))


def line(key: str, found: Found) -> str:
    """One effect in one set of measurements."""
    put = f"{key}: {found.effect}, {found.size:.1f} times the error; fit x {found.raised:.2f}"
    if found.absorbed:
        return f"{put}, absorbed"
    named = "; ".join(f"{step[0]} ({term})" for step, term in zip(found.steps, found.terms, strict=True))
    z = " ".join(f"{one:+.1f}" for one in found.z)
    return f"{put}, auto x {found.ratio:.2f}: {found.reached}, z {z} | {named}"


def _held(every: Sequence[Found]) -> str:
    z = np.abs([z for one in every for z in one.z])
    return f"{(z < TWO_SIDED_95).sum()} of {len(z)}"


COLUMNS: dict[str, Column[Found]] = {
    "put in": lambda every: str(len(every)),
    "first, or in its class": share(lambda one: one.first),
    "the most that is said of it": counted(lambda one: "absorbed" if one.absorbed else one.reached),
    "another identified": share(lambda one: bool(one.false)),
    "error, times that without": spread(lambda one: one.ratio, 2),
    "within 1.96 standard errors": _held,
}


def real_arms(rig: Path | None, mirror: Path | None, only: str) -> Iterator[tuple[str, RealArm]]:
    """The arms whose measurements can be had, by a name that contains `only`."""
    grids = {source.path.split("/")[0]: source for source in SOURCES if isinstance(source, GridSource)}
    for name, source in grids.items():
        try:
            if only in name:
                yield name, RealArm.of(source.arm, source.measured(mirror))
        except NotReachable as why:
            print(f"{name} is left out: {why}", file=sys.stderr)
    if rig and only in "rig":
        yield "rig", RealArm.of("lrm-lab", lrm.load(rig, arm="lrm-lab"))


def main() -> None:
    """Prints a row for each data set that is there."""
    options = asked(
        __doc__,
        rig=(None, "measurements of the rig"),
        mirror=(None, "folder with OWNER/NAME/PATH of the public grids, in place of the network"),
        keep=(None, "folder for the measurements with the effects"),
        out=(None, "JSON of the results; a later run goes on with it"),
        seeds=Count(22),
        first=(0, "first seed"),
        only=("", "data sets whose name contains this"),
    )
    warnings.simplefilter("ignore")  # an arm without masses, and an arm that is named by its file
    arms = dict(real_arms(options.rig, options.mirror, options.only))
    seeds = range(options.first, options.first + options.seeds)
    cases = {f"{name}-{seed}": (name, seed) for seed in seeds for name in arms}
    file = ResultsFile(options.out, Found, "lrm/implanted/1") if options.out else None
    found = run_cases(cases, partial(examine, arms, options.keep), line, file=file)
    print(table("data", {name: [found[f"{name}-{seed}"] for seed in seeds] for name in arms}, COLUMNS))


if __name__ == "__main__":
    main()
