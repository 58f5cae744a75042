"""The steps of a session, as values; what each result of a task adds to them are pure functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lrm_ident.workbench.work import tasks


def commands_text(done: Sequence[tasks.DoneCommand]) -> str:
    """One command a line."""
    return "".join(f"{command.text}\n" for command in done)


@dataclass(frozen=True)
class TakenSteps:
    """Steps, the last one being the model, with what was done as commands.

    Attributes:
        search_result: of the last search since the step. count: how many names of files were given away.
        undone: what there was before the last `undo`, which `redo` gives back; None after anything else.
    """

    steps: tuple[tasks.StepResult, ...] = ()
    search_result: tasks.SearchResult | None = None
    done: tuple[tasks.DoneCommand, ...] = ()
    count: int = 0
    undone: TakenSteps | None = None

    @property
    def last(self) -> tasks.StepResult | None:
        """The model, or None if nothing is open."""
        return self.steps[-1] if self.steps else None


def with_step(taken: TakenSteps, task: tasks.WorkTask | None, step: tasks.StepResult) -> TakenSteps:
    """After a task has given a step: a new one, or the last one with more that is known of it."""
    last = taken.last
    if step.command is not None and isinstance(task, tasks.OpenTask):
        return TakenSteps((step,), None, (step.command,), taken.count)
    if step.command is not None:  # one that goes on, as `auto` does, stands once in the list however many steps it took
        goes_on = taken.done[-1].words[:3] == step.command.words[:3]
        done = (*taken.done[: -1 if goes_on else None], step.command)
        count = taken.count + isinstance(task, tasks.AutoTask)
        return replace(taken, steps=(*taken.steps, step), search_result=None, done=done, count=count, undone=None)
    if isinstance(task, tasks.DiagnoseTask):
        same = last is not None and last.files == step.files
        return replace(taken, steps=(*taken.steps[:-1], step)) if same else taken
    if last is not None and last.files.model == step.files.model:
        same = last.data_sha256 == step.data_sha256
        return replace(taken, steps=(*taken.steps[:-1], step), undone=taken.undone if same else None)
    return replace(taken, steps=(*taken.steps, step))


def without_last(taken: TakenSteps, kept: Path) -> TakenSteps:
    """After `undo`, whose model is kept in a file: the step before is the last one again, if the page knows it."""
    last, earlier, before = taken.steps[-1], taken.steps[:-1], taken
    taken = replace(taken, undone=before)
    done = (*taken.done, tasks.DoneCommand(("undo", last.files.model, "-o", kept)))
    if earlier and earlier[-1].model == last.before:
        replaced = replace(earlier[-1], files=replace(last.files, model=kept))
        return replace(taken, steps=(*earlier[:-1], replaced), done=done)
    return replace(taken, steps=earlier, done=done)


def with_undone(taken: TakenSteps) -> TakenSteps:
    """After `redo`: all is as before the last `undo`, but for names of files, which are given away once."""
    return taken if taken.undone is None else replace(taken.undone, count=taken.count)


def with_data(taken: TakenSteps, data: Path) -> TakenSteps:
    """Steps on the same measurements from another file."""
    last = taken.steps[-1]
    return replace(taken, steps=(*taken.steps[:-1], replace(last, files=replace(last.files, data=data))), undone=None)
