"""Laws of undo and redo over random sequences of what a person does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.workbench.taken_steps import TakenSteps, with_step, with_undone, without_last
from lrm_ident.workbench.work.tasks import AddTask, AutoTask, DoneCommand, OpenFiles, OpenTask, StepResult

DATA = Path("data.csv")


def step(number: int, before: str | None, words: str = "add") -> StepResult:
    """A step whose model is its number."""
    files, command = OpenFiles(Path(f"step-{number}.toml"), DATA), DoneCommand((*words.split(), str(before)))
    return StepResult(files, "", "hash", True, "{}", "", str(number), before, command=command)


@given(st.lists(st.sampled_from(["add", "undo", "redo"]), max_size=30))
def test_undo_and_redo_are_each_others_inverse(deeds: list[str]) -> None:
    taken = with_step(TakenSteps(), OpenTask(DATA, None), step(0, None))
    models, undone = [["0"]], list[list[str]]()
    for number, deed in enumerate(deeds, 1):
        last = taken.last
        assert last is not None
        if deed == "add":
            new = step(number, last.model)
            taken = with_step(taken, AddTask(last.files, b"", new.files.model, "x"), new)
            models, undone = [*models, [*models[-1], str(number)]], []
        elif deed == "undo" and last.before is not None:
            undone.append(models.pop())
            taken = without_last(taken, Path(f"step-{number}.toml"))
        elif deed == "redo" and undone:
            models.append(undone.pop())
            taken = with_undone(taken)
        assert [one.model for one in taken.steps] == models[-1]
        assert (taken.undone is not None) == bool(undone)


def test_auto_is_one_command_however_its_files_are_called() -> None:
    taken = replace(with_step(TakenSteps(), OpenTask(DATA, None), step(0, None, "fit")), count=7)
    assert taken.last is not None
    task = AutoTask(taken.last.files, b"", Path(), 7)
    for number in (1, 2, 3):
        taken = with_step(taken, task, step(number, str(number - 1), "auto m.toml data.csv -o"))
    assert [command.words[0] for command in taken.done] == ["fit", "auto"]
    assert taken.done[-1].words[-1] == "2"
    assert taken.count == 10
