"""Report of `lrm-ident dataset check`: what the table has, and what its card lacks for others to use it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lrm_ident.data.measurement_file.conventions import Metadata
from lrm_ident.data.measurement_file.dataset_card import DatasetCard, card_faults
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.table_text.csv_file import read_table
from lrm_ident.report.document import Block, Document, ResultTable, heading

NO_NOISE = "noise_sd_mm in the metadata, or a column sd_mm: the standard deviation of a position per axis"
NOT_STANDARD = "columns with the names of docs/files.md, so that other programs read them too"


@dataclass(frozen=True, eq=False)
class DatasetCheck:
    """Measurements that the tool could read; `faults`: what is missing, by its name, and what would be right."""

    data: Measurements
    card: DatasetCard
    columns: tuple[str, ...]
    faults: Mapping[str, str]

    @classmethod
    def of(cls, data: Measurements, metadata: Metadata | None) -> DatasetCheck:
        """The check of some measurements and the metadata beside them. Raises `FileError`."""
        table = read_table(data.source.path)
        stated = tuple(column.stated for column in table.columns)
        faults = card_faults(metadata.card if metadata else None)
        if metadata is None or metadata.arm is None:
            faults["arm file"] = "arm in the metadata: a shipped arm, or the path of an arm file beside it"
        if data.sd is None and data.positions.noise_sd is None:
            faults["noise_sd_mm"] = NO_NOISE
        if not {"q1_deg"} <= {*stated} or not {"x_mm", "distance_mm"} & {*stated}:
            faults["columns"] = NOT_STANDARD
        return cls(data, (metadata.card if metadata else None) or DatasetCard(), stated, faults)


def dataset_document(found: DatasetCheck) -> Document:
    """Result of `lrm-ident dataset check`, schema `lrm/dataset-check/1`."""
    data, poses = found.data, found.data.poses
    count, sessions = len(found.faults), 1 if poses.session is None else len({*poses.session.tolist()})
    missing = f"{count} {'thing is' if count == 1 else 'things are'} missing"
    lacking = f"Not complete: {missing}. The table itself can be read."
    verdict = lacking if count else "Complete: others can use this data set."
    stated = found.card.model_dump(exclude_none=True)
    rows = [
        ("poses", str(len(data))),
        ("joints", str(poses.q.shape[1])),
        ("loads", str(len({*poses.payload.tolist()}))),
        ("sessions", str(sessions)),
        ("columns", ", ".join(found.columns)),
        *((name, value if isinstance(value, str) else ", ".join(value)) for name, value in stated.items() if value),
    ]
    blocks: list[Block] = [heading(verdict), ResultTable(("what", "is"), rows, data.source.path.name)]
    if found.faults:
        blocks.append(ResultTable(("missing", "what would be right"), tuple(found.faults.items())))
    values = {
        "verdict": "complete" if not found.faults else "not_complete",
        "poses": len(data),
        "joints": poses.q.shape[1],
        "columns": found.columns,
        "card": stated,
        "missing": dict(found.faults),
        "sha256": data.source.sha256,
    }
    return Document(blocks, "lrm/dataset-check/1", values)
