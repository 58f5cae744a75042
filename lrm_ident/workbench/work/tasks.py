"""Tasks of the workbench for its process, and what comes back of them: plain values that need none of what computes.

The page's process is up in a moment for that; `run_task.py` does the work.
"""

from __future__ import annotations

import pickle
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from lrm_math.model.reading import AS_NAMED, Reading

if TYPE_CHECKING:
    from lrm_ident.report.model_report import ModelReport

FIELD = "residual_field"
"""The effect that names no cause; its class is not loaded where the page is served."""


@dataclass(frozen=True)
class WorkProgress:
    """Progress of the work; `of` is 0 as long as its length is not known."""

    what: str
    done: int = 0
    of: int = 0


@dataclass(frozen=True)
class WorkNotice:
    """Notice of a file for a person."""

    words: str


@dataclass(frozen=True)
class WorkDone:
    """The task has ended; `failure`: why without a result, in one line, or ""."""

    failure: str = ""


@dataclass(frozen=True)
class OpenFiles:
    """The files of a session: a model and measurements, and how they are read, as the options of the commands say."""

    model: Path
    data: Path
    effects_file: Path | None = None
    reading: Reading = field(default=AS_NAMED)

    def command(self, name: str, *words: str | Path) -> DoneCommand:
        """A command on model and data."""
        return DoneCommand((name, self.model, self.data, *words), self.effects_file, self.reading)


@dataclass(frozen=True)
class DoneCommand:
    """A command: its words, and the options of reading and effects that all of them share."""

    words: tuple[str | Path, ...]
    effects_file: Path | None = None
    reading: Reading | None = None

    @property
    def text(self) -> str:
        """Text for a shell."""
        words = ["lrm-ident", *map(str, self.words)]
        if self.effects_file is not None:
            words += ["--effects-file", str(self.effects_file)]
        for name, value in ({} if self.reading is None else self.reading.said()).items():
            text = ",".join(map(str, value)) if isinstance(value, list) else str(value)
            words.append(f"--{name.replace('_', '-')}={text}")
        return shlex.join(words)


@dataclass(frozen=True)
class StepResult:
    """A step.

    Attributes:
        files: with its model. title: arm, file, and how many poses. data_sha256: of the measurements.
        diagnosed: whether there is a diagnosis; complete: whether that finds nothing missing.
        values: JSON of the figures. numbers: all tables, as HTML. packed: all that is known so far.
        model: text of the model file; before: that without the last step, or None if there is none to take back.
        command: that took it, None where more is known of one that was taken.
    """

    files: OpenFiles
    title: str
    data_sha256: str
    diagnosed: bool
    values: str
    numbers: str
    model: str
    before: str | None
    packed: bytes = b""
    complete: bool = False
    command: DoneCommand | None = None

    @cached_property
    def report(self) -> ModelReport:
        """All that is known."""
        return unpacked(self.packed)


@dataclass(frozen=True)
class SearchResult:
    """What was searched for: a law, or poses to measure next.

    Attributes:
        sentence: what there is. words: what the command prints, as HTML; or the `problem`. file: None without a result.
        effect: that the law adds. arms: JSON of the arm's frames at the poses (mm).
    """

    sentence: str
    words: str = ""
    problem: str = ""
    command: DoneCommand | None = None
    file: Path | None = None
    effect: str = ""
    arms: str = "[]"


@dataclass(frozen=True)
class OpenTask:
    """Opens measurements and a model, or fits one first; the model is kept as `kept`. Gives one step."""

    data: Path
    model: Path | None
    arm: str | None = None
    effects_file: Path | None = None
    reading: Reading = field(default=AS_NAMED)
    kept: Path = Path("step-0.toml")


@dataclass(frozen=True)
class StepTask:
    """Work on a step. `packed`: what is known of it; `kept`: file of what is made, or the folder of several."""

    files: OpenFiles
    packed: bytes = b""
    kept: Path = Path()


class CompareTask(StepTask):
    """A first comparison of a step, for instance after the measurements have grown. Gives one step."""


class DiagnoseTask(StepTask):
    """`compare` and `diagnose` of a step. Gives it with the comparison, then with the diagnosis too."""


@dataclass(frozen=True)
class AddTask(StepTask):
    """`add`: an effect at a place. Gives one step."""

    effect: str = FIELD


@dataclass(frozen=True)
class AutoTask(StepTask):
    """`auto`: follows the advice until it says stop. Gives every step as it is taken; files numbered from `number`."""

    number: int = 0


class ProposeTask(StepTask):
    """`propose`: a law where no known effect fits. Gives one law, or that there is none."""


class PosesTask(StepTask):
    """`design`: the next poses, to tell the first candidate from its strongest rival. Gives them, or why not."""


WorkMessage = WorkProgress | WorkNotice | StepResult | SearchResult | WorkDone
"""What comes back of a task: any number of results, at last whether it is done."""
Send = Callable[[WorkMessage], None]
WorkTask = OpenTask | CompareTask | DiagnoseTask | AddTask | AutoTask | ProposeTask | PosesTask


def unpacked(packed: bytes) -> ModelReport:
    """ModelReport that came from our own process."""
    report: ModelReport = pickle.loads(packed)
    return report


def kept_name(number: int) -> str:
    """Name of the file of a step."""
    return f"step-{number}.toml"


def section_html(title: str, text: str) -> str:
    """A folded section around HTML; nothing where there is none."""
    return f'<details class="lrm-fold"><summary><h2>{title}</h2></summary>{text}</details>' if text else ""
