"""Held-out error of a residual field beside names and regressors without names, on several arms.

Nested: all choices are made inside the folds, the same for every line. Option 1 of the thesis and `auto` from there are
fitted without each fold, names chosen anew; a field learns, hyperparameters and all, what that leaves of the other
folds, and regressors what option 1 leaves. The simulated arms each hide an effect that no name of the catalogue has
exactly: the first ten cases of other forms that depend on angles, loads and directions alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.auto import run_auto
from lrm_ident.fitting.cross_validation import FOLDS, joint_space_folds, random_folds
from lrm_ident.fitting.field.fit import blocks_with_field
from lrm_ident.fitting.held_out import HeldOutBlock, held_out_residual
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.residual.better_prediction import paired_z
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects.field.residual_field import ResidualField
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.reading import Reading
from validation.hidden_effects.catalogue import UNFAMILIAR
from validation.hidden_effects.data import write_data

Folds = NDArray[np.int64]
Regression = Callable[[Array, Array, Array], Array]
"""Predictions at inputs (m, n), learned from inputs (k, n) and outputs (k, 3)."""


def nested_blocks(
    data: Measurements, fold: Folds, model_without: Callable[[Measurements], Model]
) -> list[HeldOutBlock]:
    """Each fold predicted by the model that the others give."""
    blocks = []
    for number in range(FOLDS):
        train, test = np.flatnonzero(fold != number), np.flatnonzero(fold == number)
        model = model_without(data.take(train))
        left = [
            part.position_error(solve_equilibrium(model, part.poses)) for part in (data.take(train), data.take(test))
        ]
        blocks.append(HeldOutBlock(train, test, left[0], left[1]))
    return blocks


def regressed(data: Measurements, blocks: Sequence[HeldOutBlock], regression: Regression) -> Array:
    """(N, 3), what a regression on the joint angles leaves of the blocks' residuals (m)."""
    out = np.empty_like(data.tcp)
    for block in blocks:
        q, scale = data.poses.q, float(np.sqrt((block.train_residual**2).mean()))
        predicted = regression(q[block.train], block.train_residual / scale, q[block.test])
        out[block.test] = block.test_residual - scale * predicted
    return out


def outside_regressions() -> Iterator[tuple[str, Regression]]:
    """Regressions of scikit-learn, where that is installed."""
    try:
        from sklearn.ensemble import HistGradientBoostingRegressor
        from sklearn.gaussian_process import GaussianProcessRegressor, kernels
    except ImportError:
        return

    def process(known: Array, outputs: Array, unseen: Array) -> Array:
        kernel = kernels.ConstantKernel() * kernels.RBF([1.0] * known.shape[1], (0.1, 100.0)) + kernels.WhiteKernel(0.1)
        models = [GaussianProcessRegressor(kernel).fit(known, column) for column in outputs.T]
        return np.stack([model.predict(unseen) for model in models], axis=1)

    def boosting(known: Array, outputs: Array, unseen: Array) -> Array:
        models = [HistGradientBoostingRegressor(random_state=0).fit(known, column) for column in outputs.T]
        return np.stack([model.predict(unseen) for model in models], axis=1)

    yield "Gaussian process", process
    yield "gradient boosting", boosting


def lines(
    data: Measurements, fold: Folds, parameters: str = "option1", plain_name: str = "option 1"
) -> Iterator[tuple[str, Array]]:
    """Name and held-out residual (N, 3) of each way to predict, m.

    `parameters`: of the plain fit, which `auto` starts from, and its name.
    """
    assert data.arm is not None
    start, field = Study.of(data).fit(parameters).model, ResidualField(data.arm, "tool")
    plain = nested_blocks(data, fold, lambda part: fit(start, part).model)
    yield plain_name, held_out_residual(plain)
    yield f"field on {plain_name}", held_out_residual(blocks_with_field(field, data, plain))
    for name, regression in outside_regressions():
        yield f"{name} on {plain_name}", regressed(data, plain, regression)
    named = nested_blocks(data, fold, lambda part: run_auto(start, part).model)
    yield "named (`auto`)", held_out_residual(named)
    for name, regression in outside_regressions():
        yield f"{name} on named", regressed(data, named, regression)
    yield "field on named", held_out_residual(blocks_with_field(field, data, named))


def report(title: str, results: Sequence[tuple[str, Array]]) -> Table:
    """Table of held-out errors; z of the paired difference of squares against the last line (Vuong 1989)."""
    table = Table("model", "held-out mean mm", "held-out RMS mm", "z of the last line's gain", title=title)
    best = (results[-1][1] ** 2).sum(axis=1)
    for name, residual in results:
        stats, squares = error_stats(residual), (residual**2).sum(axis=1)
        table.add_row(name, f"{stats.mean * 1e3:.2f}", f"{stats.rms * 1e3:.2f}", f"{paired_z(best, squares):.1f}")
    return table


def tables(data: Measurements) -> Iterator[Table]:
    """A table for blocks of joint space, and one for random folds."""
    for title, fold in (
        ("blocks of joint space", joint_space_folds(data.poses.q, data.repeat_of)),
        ("random folds", random_folds(data.poses.q, data.repeat_of)),
    ):
        yield report(f"{len(data)} poses, {FOLDS} {title}", list(lines(data, fold)))


CASES = (
    "bends-at-near-end2", "bends-at-far-end4", "bearing3", "unequal-play2", "stick-slip3", "dahl1", "stop2", "gear1",
    "cable-over-3-and-5", "base-lifts-about-x",
)  # fmt: skip
POSES = 200
TWO_JOINT_AXES = "-x,-y,z"
PLAIN = ("identifiable", "plain fit")
"""The default of `fit`: the options of the thesis are of its own arm."""


def hidden(name: str) -> Measurements:
    """Measurements of an arm with a hidden effect."""
    with tempfile.TemporaryDirectory(prefix="hidden-") as folder:
        path, _ = write_data(UNFAMILIAR[f"{name}/tune"], 0, POSES, Path(folder))
        return load_measurements(path, load_arm("lrm-lab"))


def two_joint(path: Path) -> Measurements:
    """The measurements of the two-joint arm, its axes read as the tool says."""
    return load_measurements(path, load_arm("two-joint"), Reading(axes=TWO_JOINT_AXES))


def held_out(arms: Iterator[tuple[str, Measurements]]) -> Iterator[tuple[str, dict[str, float]]]:
    """Name of each arm, and held-out RMS (m) in blocks of joint space of each way to predict."""
    for name, data in arms:
        found = lines(data, joint_space_folds(data.poses.q, data.repeat_of), *PLAIN)
        yield name, {words: error_stats(residual).rms for words, residual in found}


def arms_table(rows: Iterator[tuple[str, dict[str, float]]]) -> Table:
    """One row per arm, as soon as it is known; one column per way to predict."""
    table = Table(title="held-out RMS mm, blocks of joint space")
    for name, errors in rows:
        if not table.columns:
            for column in ("arm", *errors):
                table.add_column(column)
        table.add_row(name, *(f"{error * 1e3:.2f}" for error in errors.values()))
        print(name, {words: round(error * 1e3, 3) for words, error in errors.items()}, flush=True)
    return table
