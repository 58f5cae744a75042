"""The figures of docs/method.md that no command of the tool prints.

`python -m validation.method_figures [MEASUREMENTS]`: with the
real measurements also how far the printed parameters miss them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.fitting.parameter_sets import no_bounds, select_parameters
from lrm_ident.fitting.priors import load_prior
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.errors import LrmError
from lrm_math.model.model import Model
from validation import synthetic, two_loads
from validation.options import asked
from validation.synthetic_measurements import measured
from validation.thesis.thesis_options import cross_apply, option_named, residual_of, run_options
from validation.thesis.thesis_results import NO_LOAD

ARM, ARMS, FRESH = "lrm-lab", 12, 300
COUNTS = (16, 20, 30, 45, 100)


def poses_needed(count: int) -> tuple[float, float | None]:
    """Median over arms of the RMS error (mm) at fresh poses: with the prior, and by elimination if it can be had."""
    rig, empty = synthetic.load_arm(shipped_arms()[ARM]), nominal_model(load_arm(ARM))
    whole = replace(empty, free=empty.keys)
    prior = load_prior("printed", whole)
    with_prior, eliminated = [], []
    for seed in range(ARMS):
        truth = synthetic.GroundTruth.random(rig, seed)
        data = measured(rig, truth, synthetic.random_poses(rig, count, seed), seed)
        q = synthetic.random_poses(rig, FRESH, seed + 999)
        fresh = measured(rig, truth, q, 0).with_tcp(synthetic.measure(rig, truth, q))
        with_prior.append(_rms_mm(fit(whole, data, prior=prior).model, fresh))
        try:
            eliminated.append(_rms_mm(fit_identifiable(empty, data, empty.keys).fit.model, fresh))
        except LrmError:
            continue
    return float(np.median(with_prior)), float(np.median(eliminated)) if len(eliminated) == ARMS else None


def cross_load(hidden: Sequence[synthetic.HiddenEffect]) -> list[list[float]]:
    """Table 6.8 of option 1₂ (mean, mm) on the pair of `validation.two_loads`, with other effects hidden."""
    rig, option = synthetic.load_arm(shipped_arms()[ARM]), option_named("option1_2")
    truth = synthetic.GroundTruth.random(rig, two_loads.SEED, tuple(hidden))
    methods = []
    for row, load in enumerate(two_loads.LOADS.values()):
        q = synthetic.random_poses(rig, two_loads.POSES, two_loads.SEED + row, floor_m=0.1)
        methods.append(run_options(load_arm(ARM), measured(rig, truth, q, row, load), options=[option]))
    crossed = cross_apply(methods[0], methods[1], option.name)
    return [[crossed.error(i, j).mean * 1e3 for j in range(2)] for i in range(2)]


def two_joints() -> tuple[int, int, float, float]:
    """Parameters, those that ten by ten poses determine, and the mean error before and after (mm)."""
    rig, model = synthetic.load_arm(shipped_arms()["two-joint"]), nominal_model(load_arm("two-joint"))
    levels = np.radians(np.linspace(-100, 100, 10))
    q = np.stack(np.meshgrid(levels, levels, indexing="ij"), axis=-1).reshape(-1, 2)
    data = measured(rig, synthetic.GroundTruth.random(rig, 3), q, 3)
    found = fit_identifiable(model, data, model.keys).fit
    before, after = error_stats(residual_of(model, data)).mean, error_stats(found.residual).mean
    return len(model.keys), len(found.model.free), before * 1e3, after * 1e3


def printed_parameters(path: Path) -> tuple[float, float]:
    """Mean error (mm) of Table B.1's option 1 on measurements, as printed and with the base placed anew."""
    arm = load_arm(ARM)
    data, model = load_measurements(path, arm), NO_LOAD.model(arm, "option1")
    placed = replace(model, free=select_parameters(model, "offsets.base.*"))
    moved = fit(placed, data, no_bounds(placed.free))
    return error_stats(residual_of(model, data)).mean * 1e3, error_stats(moved.residual).mean * 1e3


def _rms_mm(model: Model, data: Measurements) -> float:
    return error_stats(residual_of(model, data)).rms * 1e3


def main() -> None:
    """Prints them all."""
    path = asked(__doc__, "measurements?").measurements
    for count in COUNTS:
        with_prior, eliminated = poses_needed(count)
        alone = "none" if eliminated is None else f"{eliminated:.2f}"
        print(f"{count} poses: with prior {with_prior:.2f}, elimination {alone} mm RMS, median of {ARMS} arms")
    print("cross-load, nothing hidden:", np.round(cross_load(()), 2).tolist())
    print("two joints: {} parameters, {} determined, mean {:.2f} to {:.2f} mm".format(*two_joints()))
    if path:
        print("Table B.1, option 1: {:.2f} mm, base placed anew {:.2f} mm".format(*printed_parameters(path)))


if __name__ == "__main__":
    main()
