"""Report of `lrm-ident dataset check`: what the table has, and what its card lacks for others to use it."""

from __future__ import annotations

from collections.abc import Mapping

from lrm_ident.data.measurement_file.conventions import Metadata
from lrm_ident.data.measurement_file.dataset_card import DatasetCard, card_faults
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.table_text.csv_file import read_table
from lrm_ident.report.document import Block, Document, ResultTable, heading

NO_NOISE = "noise_sd_mm in the metadata, or a column sd_mm: the standard deviation of a position per axis"
NOT_STANDARD = "columns with the names of docs/files.md, so that other programs read them too"


def dataset_faults(data: Measurements, metadata: Metadata | None) -> dict[str, str]:
    """What measurements and the metadata beside them lack, by its name: what would be right. Raises `FileError`."""
    stated, faults = {*_columns(data)}, card_faults(metadata.card if metadata else None)
    if metadata is None or metadata.arm is None:
        faults["arm file"] = "arm in the metadata: a shipped arm, or the path of an arm file beside it"
    if data.sd is None and data.positions.noise_sd is None:
        faults["noise_sd_mm"] = NO_NOISE
    if "q1_deg" not in stated or stated.isdisjoint({"x_mm", "distance_mm"}):
        faults["columns"] = NOT_STANDARD
    return faults


def dataset_document(data: Measurements, card: DatasetCard | None, faults: Mapping[str, str]) -> Document:
    """Result of `lrm-ident dataset check`, schema `lrm/dataset-check/1`. `faults`: as `dataset_faults` finds them."""
    poses, count, columns = data.poses, len(faults), _columns(data)
    missing = f"{count} {'thing is' if count == 1 else 'things are'} missing"
    lacking = f"Not complete: {missing}. The table itself can be read."
    verdict = lacking if count else "Complete: others can use this data set."
    stated = (card or DatasetCard()).model_dump(exclude_none=True)
    sessions = 1 if poses.session is None else len({*poses.session.tolist()})
    rows = [
        ("poses", str(len(data))),
        ("joints", str(poses.q.shape[1])),
        ("loads", str(len({*poses.payload.tolist()}))),
        ("sessions", str(sessions)),
        ("columns", ", ".join(columns)),
        *((name, value if isinstance(value, str) else ", ".join(value)) for name, value in stated.items() if value),
    ]
    blocks: list[Block] = [heading(verdict), ResultTable(("what", "is"), rows, data.source.path.name)]
    if faults:
        blocks.append(ResultTable(("missing", "what would be right"), tuple(faults.items())))
    values = {
        "verdict": "complete" if not faults else "not_complete",
        "poses": len(data),
        "joints": poses.q.shape[1],
        "columns": columns,
        "card": stated,
        "missing": dict(faults),
        "sha256": data.source.sha256,
    }
    return Document(blocks, "lrm/dataset-check/1", values)


def _columns(data: Measurements) -> tuple[str, ...]:
    """Names of the columns as the table states them."""
    return tuple(column.stated for column in read_table(data.source.path).columns)
