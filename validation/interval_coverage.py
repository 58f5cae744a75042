"""Coverage of the confidence intervals: how often the truth lies within the stated error, on arms of the independent
generator. `python -m validation.interval_coverage` prints the shares."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.fitting.parameter_sets import no_bounds, select_parameters
from lrm_ident.fitting.priors import Prior, PriorFile, to_prior
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.arrays import Array
from lrm_math.effects import ParameterRef, effects_at
from lrm_math.model.model import Model
from validation import synthetic
from validation.options import Count, asked
from validation.runner import run_cases
from validation.synthetic_measurements import NOISE, measured

ARM, POSES, SEEDS = "lrm-lab", 100, 100
TWO_SIDED_95, THREE_SIGMA = 1.959964, 3.0
DRIFTING, DRIFT_SD, TIME_CONSTANTS = 2, 0.02, (600.0, 3600.0)  # joint, rad, s; measured for 1500 s
DRIFT = f"drift.joint{DRIFTING}.A_rad"
ARM_PRIOR = PriorFile.model_validate(
    {
        "schema": "lrm/prior/1",
        "name": "arms of the coverage run",
        "parameters": {
            "offsets.*_rad": {"sd": 0.02},
            "offsets.*_mm": {"sd": 1.5},
            "compliance.joint*": {"mean": 0.08, "sd": 0.02},
            "compliance.base*": {"mean": 0.02, "sd": 0.005},
        },
    }
)
"""The distribution of the arms, and the prior of the fit with a prior."""


@dataclass(frozen=True, eq=False)
class IntervalCoverage:
    """(estimate − truth) / standard error of every parameter, one row per arm (seeds, P)."""

    keys: tuple[str, ...]
    z: Array

    @property
    def within_95(self) -> float:
        """Share of the 95 % intervals that hold the truth."""
        return float(np.mean(np.abs(self.z) < TWO_SIDED_95))

    @property
    def within_3(self) -> float:
        """Share of the truths within three standard errors."""
        return float(np.mean(np.abs(self.z) <= THREE_SIGMA))

    @property
    def worst(self) -> tuple[str, float]:
        """The parameter whose 95 % intervals hold least, and their share."""
        share = np.mean(np.abs(self.z) < TWO_SIDED_95, axis=0)
        return self.keys[int(np.argmin(share))], float(share.min())


def option_1(seeds: Sequence[int], poses: int = POSES) -> IntervalCoverage:
    """The thesis's 28 parameters by least squares, on arms that have these errors and no others."""
    model = nominal_model(load_arm(ARM))
    return _coverage(replace(model, free=select_parameters(model, "option1")), seeds, poses, None)


def all_with_prior(seeds: Sequence[int], poses: int = POSES) -> IntervalCoverage:
    """All 45 parameters with the prior that the arms were drawn from."""
    model = nominal_model(load_arm(ARM))
    return _coverage(replace(model, free=model.keys), seeds, poses, _prior(model))


def drift_of_unknown_time_constant(seeds: Sequence[int], poses: int = POSES) -> IntervalCoverage:
    """The size of a joint's drift, added to option 1, of which the time constant is found from the same data."""
    nominal = nominal_model(load_arm(ARM))
    model = replace(nominal, free=select_parameters(nominal, "option1"))
    return IntervalCoverage((DRIFT,), np.array(list(_deviations_of_drift(model, seeds, poses))))


def _coverage(model: Model, seeds: Sequence[int], poses: int, prior: Prior | None) -> IntervalCoverage:
    return IntervalCoverage(model.free, np.array(list(_deviations(model, seeds, poses, prior))))


def _deviations(model: Model, seeds: Sequence[int], poses: int, prior: Prior | None) -> Iterator[Array]:
    arm = synthetic.load_arm(shipped_arms()[ARM])
    for seed in seeds:
        true = _drawn(model, seed)
        truth = _truth(arm, dict(zip(model.free, true.tolist(), strict=True)))
        data = measured(arm, truth, synthetic.random_poses(arm, poses, seed), seed)
        fitted = fit(model, data, no_bounds(model.free), prior=prior)
        found = np.array([fitted.model.value(key) for key in model.free])
        yield (found - true) / fitted.standard_error


def _deviations_of_drift(model: Model, seeds: Sequence[int], poses: int) -> Iterator[Array]:
    arm, [drift] = synthetic.load_arm(shipped_arms()[ARM]), effects_at(model.arm, f"drift@joint{DRIFTING}")
    t = synthetic.even_schedule(poses, len(arm.links)).time_s
    for seed in seeds:
        rng, errors = np.random.default_rng([seed, 2]), dict(zip(model.free, _drawn(model, seed).tolist(), strict=True))
        hidden = synthetic.WarmUp(DRIFTING, rng.normal(0.0, DRIFT_SD), rng.uniform(*TIME_CONSTANTS))
        truth = replace(_truth(arm, errors), effects=(hidden,))
        plain = measured(arm, truth, synthetic.random_poses(arm, poses, seed), seed)
        data = replace(plain, poses=replace(plain.poses, t=t))
        fitted = add_effects(fit(model, data, no_bounds(model.free)).model, data, [drift])
        error = fitted.standard_error[fitted.model.free.index(DRIFT)]
        yield np.array([fitted.model.value(DRIFT) - hidden.final_rad]) / error


def _drawn(model: Model, seed: int) -> Array:
    prior_of_arms = _prior(model)
    return np.random.default_rng([seed, 1]).normal(prior_of_arms.mean_of(model.free), prior_of_arms.sd_of(model.free))


def _truth(rig: synthetic.ArmDescription, values: dict[str, float]) -> synthetic.GroundTruth:
    nominal = synthetic.GroundTruth.nominal(rig)
    by = {ParameterRef.parse(key): value for key, value in values.items()}
    soft = {key.place: value for key, value in by.items() if key.id == "compliance"}
    offsets = {f"{key.place}.{key.name}": value for key, value in by.items() if key.id == "offsets"}
    named = {name.removesuffix("_mm") + "_m" if name.endswith("_mm") else name: v for name, v in offsets.items()}
    return replace(
        nominal,
        deviations=synthetic.Deviations.named(len(rig.links), named),
        base_compliance_rad_per_nm=soft["base"],
        joint_compliance_rad_per_nm=tuple(soft[f"joint{i + 1}"] for i in range(len(rig.links))),
    )


def _prior(model: Model) -> Prior:
    return to_prior(Path(ARM_PRIOR.name), ARM_PRIOR, model)


RUNS = {
    "option 1, least squares": option_1,
    "all parameters, with prior": all_with_prior,
    "drift of a joint, time constant unknown": drift_of_unknown_time_constant,
}


def examine(seeds: range, name: str) -> IntervalCoverage:
    """The coverage of a run."""
    return RUNS[name](seeds)


def line(name: str, found: IntervalCoverage) -> str:
    """The shares of a run."""
    key, share = found.worst
    return (
        f"{name}: {found.z.shape[1]} parameters; within 3 standard errors {100 * found.within_3:.2f} %; "
        f"95 % intervals hold {100 * found.within_95:.2f} % of the truths (worst: {key}, {100 * share:.0f} %)"
    )


def main() -> None:
    """Prints the shares of all runs."""
    options = asked(__doc__, seeds=Count(SEEDS), jobs=1)
    found = run_cases({name: name for name in RUNS}, partial(examine, range(options.seeds)), line, options.jobs)
    print(f"{options.seeds} arms, {POSES} random poses each, noise {NOISE * 1e3:g} mm per axis")
    print(*(line(*one) for one in found.items()), sep="\n")


if __name__ == "__main__":
    main()
