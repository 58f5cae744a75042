"""Findings of the video of a checkup: where the tip truly was, what explains it, and what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.wording import in_mm
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.measuring.camera.session import CameraMeasurements
from lrm_ident.report.document import Block, Document, ListSection, ResultTable, section
from lrm_ident.study.study import Study

SHOWN = 5


def studied(data: Measurements) -> tuple[Sequence[tuple[str, Study]], DiagnosisReport]:
    """The fit, and with what the diagnosis names, if it names anything. Raises `LrmError`."""
    fitted = Study.of(data).fit()
    found = fitted.diagnose()
    if found.first is None:
        return [("fitted", fitted)], found
    name = found.first.scored.name
    return [("fitted", fitted), (f"with {name}", fitted.add(name))], found


def with_video(
    document: Document,
    photos: CameraMeasurements,
    result: tuple[Sequence[tuple[str, Study]], DiagnosisReport],
    output: Path,
) -> Document:
    """Result of `lrm-ident checkup --video`: that of the encoders, and the table `video`."""
    steps, found = result
    nominal = steps[0][1].errors.nominal
    rows: list[tuple[str, float, float | None]] = [("as drawn", 1e3 * nominal.rms, None)]
    for name, study in steps:
        held_out = study.errors.held_out.error
        rows.append((name, 1e3 * study.errors.fitted.rms, None if held_out is None else 1e3 * held_out.rms))
    table = ResultTable(("model", "rms_mm|.2f", "held_out_rms_mm|.2f"), rows, "Tip, by the board in the video")
    of_no_use = [f"{name}: {why}" for name, why in photos.photos.refused]
    count = len(photos.data) + len(of_no_use)
    blocks: list[Block] = [f"The board is seen at {len(photos.data)} of {count} rests; {_known(photos)}."]
    if of_no_use:
        blocks.append(ListSection(f"{len(of_no_use)} rests are of no use:", tuple(of_no_use[:SHOWN])))
    blocks.append(table)
    named = None if found.first is None else found.first.scored.name
    words = found.verdict.replace("_", " ") if found.first is None else found.first.why
    next_one = f"lrm-ident fit {output} -o model.toml; lrm-ident diagnose model.toml {output}"
    blocks += section("What the video tells", (words, f"Measurements written to {output}; all of it: {next_one}"))
    video = {
        "rests": count, "used": len(photos.data), "refused": dict(photos.photos.refused), "verdict": found.verdict,
        "named": named, "errors": table.records(),
    }  # fmt: skip
    return replace(document, blocks=[*document.blocks, *blocks], values={**document.values, "video": video})


def _known(photos: CameraMeasurements) -> str:
    covariance = photos.data.covariance
    assert covariance is not None  # the camera's pipeline states it
    sd = np.sqrt(np.einsum("nii->ni", covariance[:, :3, :3]))
    return f"the tip is known to {in_mm(float(np.median(sd)))} mm per axis"
