"""`lrm-ident dataset check`, the card, and the schema that other programs read."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lrm_ident.data.examples import EXAMPLE
from lrm_ident.data.measurement_file import table_schema
from lrm_ident.data.measurement_file.dataset_card import DatasetCard, card_faults
from lrm_ident.data.table_text.csv_file import read_table
from tests.support.commands import part_of_example, run_command, stderr_of, stdout_of

CARD = """
[card]
title = "Thirty poses of the lab arm"
arm = "Printed PLA, hobby servos"
instrument = "simulated tracker"
noise = "as simulated"
date = "2024-07-15"
authors = ["A. Nobody"]
licence = "CC-BY-4.0"
"""


def carded(folder: Path, card: str = CARD) -> Path:
    """Thirty poses with a card."""
    data = part_of_example(folder, 30)
    metadata = data.with_suffix(".toml")
    metadata.write_text(metadata.read_text(encoding="utf-8") + card, encoding="utf-8")
    return data


def test_the_schema_is_the_codes() -> None:
    """`make schemas` writes it."""
    assert table_schema.FILE.read_text(encoding="utf-8") == table_schema.text()


def test_the_example_is_a_table_of_the_schema() -> None:
    row = table_schema.schema()["$defs"]["Row"]
    table = read_table(EXAMPLE)
    assert {*table.header} <= {*row["properties"]}
    for cells in table.rows:
        for name, cell in zip(table.header, cells, strict=True):
            kind = row["properties"][name]
            assert float(cell) >= kind.get("minimum", float(cell))
            assert float(cell) <= kind.get("maximum", float(cell))


def test_rows_with_a_fault_are_none_of_the_schema() -> None:
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    row = table_schema.schema()["$defs"]["Row"]
    good = {"pose": 1, "q1_deg": 2.0, "x_mm": 1.0, "y_mm": 2.0, "z_mm": 3.0, "payload_g": 0.0}
    jsonschema.validate(good, row)
    for bad in ({"payload_g": -1.0}, {"pose": 1.5}, {"q1_deg": "two"}, {"sd_mm": 0}, {"x_mm": "left"}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(good | bad, row)


def test_a_complete_data_set_is_called_complete(tmp_path: Path) -> None:
    code, stdout, stderr = run_command("dataset", "check", carded(tmp_path), "--json", tmp_path / "check.json")
    assert code == 0, stderr
    assert stdout.startswith("Complete: others can use this data set.")
    found = json.loads((tmp_path / "check.json").read_text(encoding="utf-8"))
    assert (found["verdict"], found["poses"], found["missing"]) == ("complete", 30, {})


def test_what_is_missing_is_named_with_what_would_be_right(tmp_path: Path) -> None:
    data = carded(tmp_path, CARD.replace('licence = "CC-BY-4.0"', 'licence = "ask me"').replace("title", "url"))
    code, stdout, stderr = run_command("dataset", "check", data)
    assert code == 2
    assert stderr.splitlines()[-1].endswith(
        f"not complete: title, licence; add them to {data.stem}.toml, see docs/dataset.md"
    )
    assert "'ask me' is none of CC0-1.0" in stdout


def test_a_card_with_a_word_that_it_does_not_have_is_refused(tmp_path: Path) -> None:
    assert "licens" in stderr_of("dataset", "check", carded(tmp_path, CARD.replace("licence", "licens")))


@pytest.mark.long
def test_a_card_changes_no_number(tmp_path: Path) -> None:
    with_card, without = tmp_path / "a", tmp_path / "b"
    for folder, data in ((with_card, carded), (without, lambda folder: part_of_example(folder, 30))):
        folder.mkdir()
        stdout_of("fit", data(folder), "-o", folder / "m.toml", "--json", folder / "f.json")
    one, other = (json.loads((folder / "f.json").read_text(encoding="utf-8")) for folder in (with_card, without))
    assert one["estimates"] == other["estimates"]


def test_an_empty_card_lacks_everything_but_what_is_optional() -> None:
    assert list(card_faults(None)) == [name for name in DatasetCard.model_fields if name != "url"]
