"""Pages of proofs: they are made from the results beside them, no number is typed by hand, tests named are there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from tests.conftest import ROOT
from validation.proofs.guarantees import guarantees
from validation.proofs.pages import PAGES, pages
from validation.proofs.result_file import FOLDER, ProofResult, computed, read, write

RESULTS = sorted(FOLDER.glob("*.json"))


def test_every_page_is_made_from_the_result_beside_it() -> None:
    """`make proofs` makes them."""
    made = pages()
    assert [path.name for path in sorted(made)] == [path.name for path in sorted(FOLDER.glob("*.md"))]
    for path, text in made.items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name} is not what its result says: make proofs"


def test_every_page_has_its_result() -> None:
    assert [path.stem for path in RESULTS] == sorted(page.name for page in PAGES)


def test_no_number_is_typed_by_hand() -> None:
    """Words beside the table have none but those of names, code and JSON."""
    for page in PAGES:
        words = re.sub(
            r"```.*?```|`[^`]*`|\[[^]]*\]\([^)]*\)|lrm/\w+/\d", "", page.conclusion + page.reading, flags=re.S
        )
        assert not re.findall(r"\d", words), page.name


@pytest.mark.parametrize("path", RESULTS, ids=lambda path: path.stem)
def test_a_result_says_how_it_came_about(path: Path) -> None:
    result = read(path)
    assert result.rows
    assert all(len(row) == len(result.columns) for row in result.rows)
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", result.date)
    assert re.fullmatch(r"[0-9a-f]{7,}\+?", result.commit)
    assert result.command.startswith("python -m ")
    assert "/" not in result.command.replace("docs/", "")


def test_a_result_is_read_as_it_was_written(tmp_path: Path) -> None:
    result = computed(("a, mm", "b"), [(1.5, "x"), (None, ["t::u"])])
    write(tmp_path / "r.json", result)
    assert read(tmp_path / "r.json") == result
    (tmp_path / "other.json").write_text('{"schema": "lrm/model/1"}', encoding="utf-8")
    with pytest.raises(ValueError, match="should be of the schema lrm/proof/1"):
        read(tmp_path / "other.json")


def test_a_cell_may_hold_what_a_table_needs_escaped() -> None:
    result = ProofResult(("a", "b"), (("x|y", 1),), "python -m x", "2026-01-01", "abcdef12", "m")
    assert "| x\\|y | 1 |" in PAGES[0].text(result)


def test_every_test_that_holds_a_guarantee_is_there() -> None:
    for guarantee in guarantees():
        assert guarantee.tests
        for test in guarantee.tests:
            file, _, name = test.partition("::")
            tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
            assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, test


def test_the_committed_guarantees_are_those_stated_and_none_failed() -> None:
    result = read(FOLDER / "guarantees.json")
    assert [row[0] for row in result.rows] == [one.says for one in guarantees()]
    for says, _, tests, passed, failed, skipped, named in result.rows:
        assert failed == 0, says
        assert passed + skipped == tests, says  # type: ignore[operator]
        assert tests >= len(named), says  # type: ignore[operator, arg-type]
        assert passed > 0, says  # type: ignore[operator]
