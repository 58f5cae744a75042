"""Tables of a model file: its steps, and where it comes from."""

from __future__ import annotations

from lrm_ident.data.wording import decimals, enumerate_words
from lrm_ident.report.document import ResultTable
from lrm_ident.report.plain_names import in_words
from lrm_math.effects import marked
from lrm_math.model.model_file import HistoryTable, ModelFile

POSES_SHOWN = 20


HASH_SHOWN = 8
"""Digits of a data set's SHA-256 that are shown: enough to tell data sets of one person apart."""


def data_of(entry: HistoryTable) -> str:
    """First digits of the SHA-256 of the data that a step's errors are of; "" where that is not known."""
    return "" if entry.provenance is None else entry.provenance.data_sha256[:HASH_SHOWN]


def history_table(file: ModelFile) -> ResultTable:
    """Every step of a model's history with its error in the fit and held out, and the data that these are of."""
    known = [value for entry in file.history for value in (entry.fit_rms_mm, entry.held_out_rms_mm) if value]
    spec = f".{decimals(*known)}f"
    rows = [
        (number, in_words(entry.step), entry.fit_rms_mm, entry.held_out_rms_mm, data_of(entry))
        for number, entry in enumerate(file.history)
    ]
    columns = ("|", "step", f"fit RMS mm|{spec}", f"held out RMS mm|{spec}", "data (SHA-256)|")
    return ResultTable(columns, rows, "Steps")


def history_values(file: ModelFile) -> list[dict[str, object]]:
    """History for JSON, unrounded."""
    return [
        {
            "step": entry.step,
            "fit_rms_mm": entry.fit_rms_mm,
            "held_out_rms_mm": entry.held_out_rms_mm,
            "data_sha256": None if entry.provenance is None else entry.provenance.data_sha256,
        }
        for entry in file.history
    ]


def provenance_table(file: ModelFile) -> ResultTable:
    """Provenance of a model: data, tool, date, how it was fitted."""
    known = file.provenance
    rows: list[tuple[str, str]] = [("arm", file.arm), ("effects", ", ".join(map(marked, file.effects)))]
    if known is not None:
        rows += [
            ("data", known.data),
            ("SHA-256 of the data", known.data_sha256),
            *([("SHA-256 of the arm", known.arm_sha256)] if known.arm_sha256 is not None else []),
            ("poses fitted", str(known.poses)),
            ("loss", known.loss),
            ("tool", known.tool),
            ("date", known.date),
        ]
        if known.prior is not None:
            rows.append(("prior", known.prior))
        if known.left_out:
            rows.append(("poses left out", enumerate_words(list(map(str, known.left_out)), POSES_SHOWN)))
        if known.reading is not None:
            rows += [(f"read with {name}", str(value)) for name, value in known.reading.said().items()]
        if known.effects_file is not None:
            rows += [("effects file", known.effects_file), ("its SHA-256", str(known.effects_sha256))]
    return ResultTable(("what", "value"), rows, "Where the model comes from")
