"""JSON Schema (draft 2020-12) of a measurement file's rows and card: `python -m
lrm_ident.data.measurement_file.table_schema`.

It is made from the columns that the tool reads, and shipped as `measurements.schema.json` for other programs.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from lrm_ident.data.measurement_file.conventions import Metadata
from lrm_ident.data.measurement_file.known_columns import (
    KNOWN,
    NO_NEGATIVE_TIME,
    NOT_BELOW_ZERO,
    WHOLE,
    quantities_of_joints,
)
from lrm_ident.data.measurement_file.pose_quantity import ABOVE_ZERO, DISTANCE, POSITION, PoseQuantity

FILE = Path(__file__).with_name("measurements.schema.json")
MOST_JOINTS = 10
UNITS = {"mm": "mm", "deg": "deg", "s": "s", "g": "g", "c": "degC", "v": "V", "mm2": "mm^2", "deg2": "deg^2"}
DESCRIPTION = (
    "A measurement file is a CSV (comma, decimal point, UTF-8, one header line) with one row per pose in the order "
    "measured; NAME.toml beside NAME.csv holds the metadata and the card. docs/dataset.md"
)


def schema() -> dict[str, Any]:
    """The schema document: a row, and the metadata beside the table."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema", "title": "lrm/measurements/1",
        "description": DESCRIPTION, "$ref": "#/$defs/Row",
        "$defs": {"Row": _row(), "Metadata": Metadata.model_json_schema(ref_template="#/$defs/{model}")},
    }  # fmt: skip


def text() -> str:
    """The content of the shipped file."""
    document = schema()
    document["$defs"] |= document["$defs"]["Metadata"].pop("$defs", {})
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _row() -> dict[str, Any]:
    quantities = (*quantities_of_joints(MOST_JOINTS), *KNOWN)
    together = {
        column: [other for other in quantity.columns if other != column]
        for quantity in quantities
        if quantity.whole or quantity.name.endswith("covariance")
        for column in quantity.columns
    }
    return {
        "type": "object",
        "properties": {column: _cell(quantity, column) for quantity in quantities for column in quantity.columns},
        "required": ["q1_deg"],
        "anyOf": [{"required": list(POSITION)}, {"required": [DISTANCE]}],
        "dependentRequired": together,
    }


def _cell(quantity: PoseQuantity, column: str) -> dict[str, Any]:
    unit = UNITS.get(column.rpartition("_")[2], "")
    words = quantity.size.words if quantity.size else quantity.name.replace("_", " ")
    cell: dict[str, Any] = {"description": f"{words}, {unit}" if unit else words}
    cell["type"] = _type(quantity)
    if quantity.rule is ABOVE_ZERO:
        cell["exclusiveMinimum"] = 0
    if quantity.rule in (NOT_BELOW_ZERO, NO_NEGATIVE_TIME):
        cell["minimum"] = 0
    if quantity.size is not None and quantity.rule is None:
        cell |= {"minimum": -quantity.size.high, "maximum": quantity.size.high}
    return cell


def _type(quantity: PoseQuantity) -> list[str] | str:
    kind = "integer" if quantity.rule is WHOLE else "number"
    return [kind, "null"] if quantity.may_be_empty or quantity.unless else kind


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
    print(FILE)
