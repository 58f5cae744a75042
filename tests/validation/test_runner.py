"""The runner of all catalogues: order, processes, a file that a later run goes on with; and the options of programs."""

from __future__ import annotations

import importlib
import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from lrm_math.errors import FileError, LrmError
from validation.hidden_effects.outcome import Outcome
from validation.options import asked
from validation.runner import ResultsFile, run_cases
from validation.tables import table

CASES = {"three": 3, "one": 1, "two": 2}


@dataclass(frozen=True)
class Square:
    """A result with a tuple, which JSON does not have."""

    value: int
    factors: tuple[int, ...]


def squared(number: int) -> Square:
    return Square(number**2, (number, number))


def failing(number: int) -> Square:
    if number == 2:
        raise LrmError("no square of two")
    return squared(number)


def line(key: str, one: Square) -> str:
    return f"{key}: {one.value}"


@pytest.mark.long
@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_the_order_of_the_cases(jobs: int, capfd: pytest.CaptureFixture[str]) -> None:
    found = run_cases(CASES, squared, line, jobs)
    assert [*found.items()] == [("three", squared(3)), ("one", squared(1)), ("two", squared(2))]
    said = capfd.readouterr().err.splitlines()
    assert [words.split()[0] for words in said] == ["1/3", "2/3", "3/3"]
    assert {words.partition(" ")[2] for words in said} == {"three: 9", "one: 1", "two: 4"}


def test_a_later_run_goes_on_where_one_ended(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = ResultsFile(tmp_path / "out" / "found.json", Square, "squares/1", {"noise": 0.5})
    with pytest.raises(LrmError, match="no square"):
        run_cases(CASES, failing, line, file=file)
    assert file.read() == {"three": squared(3), "one": squared(1)}
    capsys.readouterr()
    found = run_cases(CASES, squared, line, file=file)
    assert capsys.readouterr().err == "1/1 two: 4\n"
    assert found == file.read() == {key: squared(number) for key, number in CASES.items()}
    assert '"noise": 0.5' in file.path.read_text(encoding="utf-8")


def test_results_of_other_code_are_refused_and_failed_cases_computed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = ResultsFile(tmp_path / "found.json", Square, "squares/1", failed=lambda one: one.value == 4)
    run_cases(CASES, squared, line, file=file)
    assert [*file.read()] == ["three", "one"]
    monkeypatch.setattr("validation.runner.COMMIT", "01234567")
    with pytest.raises(FileError, match="the code is 01234567"):
        file.read()


def test_a_number_that_json_lacks_is_null_and_its_case_is_computed_again(tmp_path: Path) -> None:
    file = ResultsFile(tmp_path / "found.json", Outcome, "hidden-effects/1")
    known = Outcome("play2", 3, z=(1.0,))
    file.write({"known": known, "unknown": Outcome("play2", 4, z=(math.nan,))})
    document = json.loads(file.path.read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert document["cases"]["unknown"]["z"] == [None]
    assert file.read() == {"known": known}


@pytest.mark.parametrize(
    "program",
    [
        "hidden_effects.__main__ --only nowhere",
        "motion.__main__ --only nowhere",
        "as_deployed.__main__ --only nowhere",
        "proofs.real_arms --data nowhere",
        "interval_coverage --seeds 0",
        "transfer --seeds 0",
        "hidden_effects.__main__ --poses 0",
        "swinging_arm.__main__ --moves -1",
    ],
)
def test_no_case_is_one_line_and_exit_code_2(
    program: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    module, *_ = words = program.split()
    monkeypatch.setattr(sys, "argv", words)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        importlib.import_module(f"validation.{module}").main()
    assert end.value.code == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize(
    "text", ["{", "[]", '{"schema": "cubes/1", "cases": {}}', '{"schema": "squares/1", "cases": 3}']
)
def test_another_file_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "found.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileError, match="holds no results of squares/1"):
        run_cases(CASES, squared, line, file=ResultsFile(path, Square, "squares/1"))


def test_an_outcome_comes_back_from_its_file_as_it_was(tmp_path: Path) -> None:
    outcome = Outcome("play2", 3, (("backlash@joint2", "drift@joint2"),), "effect_missing", 1.02, findings=(True,))
    file = ResultsFile(tmp_path / "found.json", Outcome, "hidden-effects/1")
    file.write({"play2/3": outcome})
    assert file.read() == {"play2/3": outcome}


def test_options_take_the_types_of_their_defaults(monkeypatch: pytest.MonkeyPatch) -> None:
    words = [
        "program",
        "a",
        "b",
        "--pwm",
        "50",
        "330",
        "--pwm",
        "1",
        "--name",
        "x",
        "--quick",
        "--out",
        "c",
        "--seeds",
        "3",
    ]
    monkeypatch.setattr(sys, "argv", words)
    given = asked(
        None, "folders+", pwm=[25.0], kinds=["off"], name="", quick=False, out=None, jobs=1, seeds=[int], only=[str]
    )
    assert given.folders == [Path("a"), Path("b")]
    assert (given.pwm, given.kinds, given.name, given.quick) == ([50.0, 330.0, 1.0], ["off"], "x", True)
    assert (given.out, given.jobs, given.seeds, given.only) == (Path("c"), 1, [3], [])


def test_a_table_has_a_row_for_each_group_with_results() -> None:
    text = table("kind", {"few": [1, 2], "none": [], "many": [3, 4, 5]}, {"number": lambda found: str(len(found))})
    assert text.splitlines() == ["| kind | number |", "| --- | --- |", "| few | 2 |", "| many | 3 |"]
