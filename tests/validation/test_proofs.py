"""Pages of proofs and pictures are made by scripts from results."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.support.source_files import syntax_tree
from validation.doc_pictures import COMMANDS, PICTURES
from validation.proofs.guarantees import guarantees
from validation.proofs.history import continued, line_of
from validation.proofs.pages import PAGES, pages
from validation.proofs.readme_table import README, RESULT, readme, with_rows
from validation.proofs.result_file import FOLDER, ProofResult, computed, read, write

RESULTS = sorted(FOLDER.glob("*.json"))


def test_every_page_is_made_from_the_result_beside_it() -> None:
    """`make proofs` makes them."""
    made = pages()
    assert [path.name for path in sorted(made)] == [path.name for path in sorted(FOLDER.glob("*.md"))]
    for path, text in made.items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name} is not what its result says: make proofs"


def test_readme_has_the_errors_of_the_real_arms() -> None:
    """`make proofs` writes them."""
    text = README.read_text(encoding="utf-8")
    assert readme() == {README: text}
    arm, model, poses, *_, deployed = read(RESULT).rows[0]
    assert model == "nominal"
    assert f"| {arm}, {poses} poses | {deployed:.3g} |" in text
    with pytest.raises(ValueError, match="there should be a table"):
        with_rows("# README\n", read(RESULT))


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


@pytest.mark.long
def test_every_test_that_holds_a_guarantee_is_there() -> None:
    for guarantee in guarantees():
        assert guarantee.tests
        for test in guarantee.tests:
            file, _, name = test.partition("::")
            tree = syntax_tree(ROOT / file)
            assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, test


def test_the_committed_guarantees_are_those_stated_and_none_failed() -> None:
    result = read(FOLDER / "guarantees.json")
    assert [row[0] for row in result.rows] == [one.says for one in guarantees()]
    for says, _, tests, passed, failed, skipped, named in result.rows:
        assert failed == 0, says
        assert passed + skipped == tests, says  # type: ignore[operator]
        assert tests >= len(named), says  # type: ignore[operator, arg-type]
        assert passed > 0, says  # type: ignore[operator]


def test_a_line_of_the_history_has_the_ratios_to_peers_and_a_commit_has_one_a_day() -> None:
    speed = ProofResult(
        ("what", "by", "ratio"), (("fk", "lrm_math", "1.00"), ("fk", "pinocchio", "4.9")), "c", "2026-01-02", "a", "m"
    )
    line = line_of(speed, "success")
    assert line == {"date": "2026-01-02", "commit": "a", "soak": "success", "fk: pinocchio": "4.9"}
    first = continued(None, line)
    assert continued(first, line).rows == first.rows
    other = {"date": "2026-01-09", "commit": "b", "soak": "failure", "fit: scipy": "1.2"}
    assert continued(first, other).rows == (
        ("2026-01-02", "a", "success", "4.9", None),
        ("2026-01-09", "b", "failure", None, "1.2"),
    )


@pytest.mark.long
def test_the_history_is_kept_in_a_branch_of_its_own(tmp_path: Path) -> None:
    """The script that the weekly workflow and the site run, twice, against a remote of this machine."""
    remote, work = tmp_path / "remote.git", tmp_path / "work"
    subprocess.run(["git", "init", "--quiet", "--bare", remote], check=True)
    for part in ("packaging/history.sh", "validation/__init__.py", "validation/commit.py", "validation/proofs"):
        copy = shutil.copytree if (ROOT / part).is_dir() else shutil.copyfile
        (work / part).parent.mkdir(parents=True, exist_ok=True)
        copy(ROOT / part, work / part)
    (work / "docs" / "proofs").mkdir(parents=True)
    subprocess.run(["git", "init", "--quiet", work], check=True)
    subprocess.run(["git", "remote", "add", "origin", remote], cwd=work, check=True)
    for soak in ("success", "failure"):
        script = ["sh", "packaging/history.sh", str(FOLDER / "speed.json"), soak]
        subprocess.run(script, cwd=work, check=True, capture_output=True)
        (work / "docs" / "proofs" / "history.json").unlink()
    subprocess.run(["sh", "packaging/history.sh"], cwd=work, check=True, capture_output=True)
    assert [row[2] for row in read(work / "docs" / "proofs" / "history.json").rows] == ["failure"]
    log = ["git", "log", "--oneline", "history"]
    assert len(subprocess.run(log, cwd=remote, check=True, capture_output=True).stdout.splitlines()) == 2
    assert "| failure |" in (work / "docs" / "proofs" / "history.md").read_text(encoding="utf-8")


OF_A_PAGE = {"social-card"}
"""Screenshots, by `validation.workbench.story`."""
OF_A_CHECKOUT = {"cross-load", "options", "fleet", "swing", "sockets"}
"""Drawn by studies that docs/tried.md names with their commit."""


def test_every_picture_has_a_script_and_every_script_a_picture() -> None:
    assert {path.stem for path in PICTURES.glob("*.png")} - OF_A_PAGE - OF_A_CHECKOUT == {*COMMANDS}
