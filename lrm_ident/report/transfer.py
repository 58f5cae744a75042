"""Report of `lrm-ident transfer`: what goes along with the arm, its installation, the tip's expected error."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.report.document import Block, Document, ResultTable, heading
from lrm_ident.report.fit import estimate_table
from lrm_ident.report.plain_names import effects_in_words, enumerate_effects
from lrm_ident.study.parameter_estimates import parameter_estimates
from lrm_ident.study.transfer import Transfer
from lrm_math.effects import ModelPart

NOISIER = 2.0
"""Residual of the poses over the bench's error, from which on something else is different."""
AXES = 3


def transfer_document(transferred: Transfer, expected: Mapping[int, float]) -> Document:
    """Result of `lrm-ident transfer`, schema `lrm/transfer/1`. `expected`: RMS error of the tip (m), by poses."""
    start = transferred.start
    bench_error = transferred.bench_error
    arm_effects = [effect for effect in start.model.effects if effect.part is ModelPart.ARM]
    rows = [(str(count), *_both(error, bench_error)) for count, error in expected.items()]
    if transferred.data is not None:
        rows.append((f"{len(transferred.data)}, as given", *_both(transferred.expected_tip_error, bench_error)))
    columns = ("poses measured here", "of the parameters, mm|.2f", "with the error left on the bench, mm|.2f")
    count_from_bench = len(start.covariance.keys) - len(start.installed)
    blocks: list[Block] = [
        heading(f"{start.bench} -> {start.model.arm.name}: {count_from_bench} parameters of the arm go along"),
        f"Of the arm, with standard errors: {effects_in_words([effect.name for effect in arm_effects])}.",
        f"Stays behind, as of the bench: {enumerate_effects(start.left_behind, len(start.left_behind))}.",
        *([start.state] if start.state else []),
        ResultTable(columns, rows, "Expected error of the tip over the arm's range, RMS"),
        *_identified(transferred),
    ]
    values = {
        "from": start.bench,
        "to": start.model.arm.name,
        "effects": [effect.name for effect in arm_effects],
        "left_behind": start.left_behind,
        "state": start.state,
        "bench_rms_mm": bench_error * 1e3,
        "expected_rms_mm": {str(count): error * 1e3 for count, error in expected.items()},
        "poses": None if transferred.data is None else len(transferred.data),
        "identified_rms_mm": None if transferred.data is None else transferred.expected_tip_error * 1e3,
        "residual_rms_mm": None if transferred.fit is None else error_stats(transferred.fit.residual).rms * 1e3,
        "parameters": transferred.file.parameters,
        "sigma": transferred.file.sigma,
    }
    return Document(blocks, "lrm/transfer/1", values)


def _both(error: float, error_left: float) -> tuple[float, float]:
    return error * 1e3, math.hypot(error, error_left) * 1e3


def _identified(transferred: Transfer) -> Iterator[Block]:
    """The installation as identified, and whether the poses agree with the arm."""
    start = transferred.start
    if transferred.fit is None:
        yield (
            "No poses were given: base and tool are as the arm file says. To measure the installation: "
            f"lrm-ident design {transferred.arm} --model MODEL --installation -o few-poses.csv"
        )
        return
    errors = {key: estimate.standard_error for key, estimate in parameter_estimates(transferred.fit).items()}
    yield estimate_table(transferred.fit.model.with_free(start.installed), errors)
    residual, usual = transferred.fit.sigma * math.sqrt(AXES), start.noise * math.sqrt(AXES)
    yield f"The poses are met to {error_stats(transferred.fit.residual).rms * 1e3:.2f} mm RMS."
    if np.isfinite(residual) and residual > NOISIER * usual:
        yield (
            f"They differ from the model by {residual * 1e3:.2f} mm RMS, more than twice the {usual * 1e3:.2f} mm of "
            "the bench. Is the arm the same, is its tool fixed, is this tracker noisier (--noise-mm)?"
        )
