"""What all commands share: the consoles, reading of inputs, and the one writer of results."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.progress import Progress

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.effect_plugins import Catalogue
from lrm_ident.fitting.progress import OnProgress
from lrm_ident.report.document import Block, Document, ResultTable, write
from lrm_ident.study import inputs
from lrm_ident.study.inputs import ModelInputs
from lrm_ident.study.steps import NamedProgress
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.errors import FileError, LrmError, UnknownName
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import ModelFile, load_model
from lrm_math.model.reading import AS_NAMED, Reading

out = Console(width=None if sys.stdout.isatty() else 100)
log = Console(stderr=True)
LISTED = 15  # lines of a list without --all
Name = TypeVar("Name", bound=str)


def show(*blocks: Block) -> None:
    """Prints text and tables."""
    write(out, blocks)


def publish(
    result: Document,
    json: Path | None,
    figure: Path | None = None,
    draw: Callable[[Path], None] | None = None,
    most: int | None = None,
) -> None:
    """Prints a result (`most` lines of a list), then writes its JSON file, its figure, and the numbers behind that."""
    write(out, result.blocks, most)
    if json:
        write_text(json, result.json())
    if figure and draw:
        publish_figure(figure, draw, result.behind)


def publish_figure(figure: Path, draw: Callable[[Path], None], behind: ResultTable | None) -> None:
    """Draws a figure; the numbers behind it are written beside it as CSV."""
    draw(figure)
    if behind is None:
        show(f"Figure written to {figure}")
    else:
        numbers = figure.with_suffix(".csv")
        write_text(numbers, behind.csv())
        show(f"Figure written to {figure}, its data to {numbers}")


def check_distinct(figure: Path | None, *others: Path | None) -> None:
    """Raises `FileError` if another file has the name under which the numbers behind a figure will be written."""
    behind = None if figure is None else figure.with_suffix(".csv")
    if behind is not None and behind.resolve() in [other.resolve() for other in others if other]:
        raise FileError(behind, "", f"is where the numbers behind {figure} go", "give the two files different names")


def read_model(path: Path, catalogue: Catalogue) -> tuple[ModelFile, Model]:
    """A model file, as it stands and as a model; notices go to stderr."""
    return inputs.read_model(path, catalogue, notice)


def read_inputs(model: Path, data: Path, effects_file: Path | None, reading: Reading = AS_NAMED) -> ModelInputs:
    """A model file and measurements of its arm read as those of its fit; notices go to stderr."""
    return inputs.read_inputs(model, data, effects_file, notice, reading)


def read_identifiable(model: Path, data: Path, effects_file: Path | None, reading: Reading = AS_NAMED) -> ModelInputs:
    """The same with a model whose free parameters the data alone identify, whatever a prior decided in the fit."""
    return inputs.identifiable(read_inputs(model, data, effects_file, reading), notice)


def leave_out_poses(data: Measurements, text: str) -> Measurements:
    """The measurements without the poses of these numbers and ranges, as in `12,40-42`. Raises `LrmError`."""
    numbers: list[int] = []
    for word in filter(None, (part.strip() for part in text.split(","))):
        first, _, last = word.partition("-")
        if not (first.isdigit() and (last or first).isdigit()):
            raise LrmError(f"--leave-out {text}: '{word}' is no pose number; give numbers and ranges such as 12,40-42")
        numbers += range(int(first), int(last or first) + 1)
    unknown = sorted(set(numbers) - set(data.pose.tolist()))
    if unknown:
        raise LrmError(f"--leave-out {text}: {data.path.name} has no pose {unknown[0]}")
    return data.without(numbers) if numbers else data


def start_model(arm: Arm, model: Path | None) -> Model:
    """The nominal arm with the thesis's 45 parameters, or a fitted model of the same arm. Raises `FileError`."""
    if model is None:
        return model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))
    fitted = load_model(model)
    if fitted.arm != arm:
        raise FileError(model, "arm", f"is a model of {fitted.arm.name}, not of {arm.name}")
    return fitted


def read_measurements(
    path: Path, arm: Arm, arm_name: str, reading: Reading = AS_NAMED, usual: Reading | None = None
) -> Measurements:
    """Measurements that the arm can have made; what a person should know of the file goes to stderr."""
    return inputs.read_measurements(path, arm, arm_name, notice, reading, usual)


def notice(words: str) -> None:
    """What a person should know, on stderr."""
    log.print(f"notice: {words}")


def parse_numbers(option: str, text: str, example: str) -> list[float]:
    """Numbers by commas. Raises `LrmError`."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise LrmError(f"{option} {text}: not {example}") from None


def one_of(what: str, name: str, names: Sequence[Name]) -> Name:
    """The one of the names that is meant. Raises `UnknownName`."""
    for known in names:
        if known == name:
            return known
    raise UnknownName(what, name, names)


@contextmanager
def progress(what: str) -> Iterator[OnProgress]:
    """A bar on stderr, on a terminal only."""
    with Progress(console=log, transient=True, disable=not log.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)


@contextmanager
def named_progress() -> Iterator[NamedProgress]:
    """Bars on stderr for several parts of a work, on a terminal only."""
    with Progress(console=log, transient=True, disable=not log.is_terminal) as bar:

        def named(what: str) -> OnProgress:
            task = bar.add_task(what, total=None)
            return lambda done, of: bar.update(task, completed=done, total=of)

        yield named
