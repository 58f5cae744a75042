"""Parts that all commands share: the consoles, reading of inputs, and the one writer of results."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TypeVar

from rich.progress import Progress as Bars
from rich.progress import TaskID

from lrm_ident.cli.consoles import animated, log, out
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurement_file.load import load_pose_table, pose_doubts
from lrm_ident.data.measurements import Measurements, Part, every_pose
from lrm_ident.data.wording import in_minutes
from lrm_ident.fitting.effect_plugins import Catalogue
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.fitting.progress import OnProgress, Progress, TimeOfParts
from lrm_ident.report.document import Block, Document, ResultTable, write
from lrm_ident.study import inputs
from lrm_ident.study.notices import Notice
from lrm_ident.study.study import Study
from lrm_math.arm.arm import Arm
from lrm_math.errors import FileError, LrmError, UnknownName
from lrm_math.kinematics.poses import Poses
from lrm_math.model.model import Model
from lrm_math.model.model_file import ModelFile, load_model
from lrm_math.model.reading import AS_NAMED, Reading

LISTED = 15  # lines of a list without --all
Name = TypeVar("Name", bound=str)


def show(*blocks: Block) -> None:
    """Prints text and tables."""
    write(out, blocks)


def publish(
    result: Document,
    json: Path | None,
    figure: Path | None = None,
    draw: Callable[[Path], object] | None = None,
    in_full: bool = True,
) -> None:
    """Writes a result's JSON file, prints its conclusion or, `in_full`, all of it, and draws its figure."""
    if json:
        write_text(json, result.json())
    write(out, result.printed(in_full), None if in_full else LISTED)
    if figure and draw:
        publish_figure(figure, draw, result.behind)


def publish_figure(figure: Path, draw: Callable[[Path], object], behind: ResultTable | None) -> None:
    """Draws a figure; the numbers behind it are written beside it as CSV."""
    draw(figure)
    if behind is None:
        show(f"Figure written to {figure}")
    else:
        numbers = figure.with_suffix(".csv")
        write_text(numbers, behind.csv())
        show(f"Figure written to {figure}, its data to {numbers}")


def read_model(path: Path, catalogue: Catalogue) -> tuple[ModelFile, Model]:
    """A model file, as it stands and as a model; notices go to stderr."""
    file, model, notices = inputs.read_model(path, catalogue)
    notice(*notices)
    return file, model


@contextmanager
def opened(
    model: Path,
    data: Path,
    effects_file: Path | None,
    reading: Reading = AS_NAMED,
    part: Callable[[Measurements, Sequence[int]], Measurements] = Measurements.without,
) -> Iterator[Study]:
    """A study from its files, which shows what it does as bars on stderr; notices go there, too."""
    with bars() as progress:
        study = inputs.read_study(model, data, effects_file, reading, progress, part)
        notice(*study.notices)
        yield study


def identifiable(study: Study) -> Study:
    """The study with free parameters that the data alone identify; a notice goes to stderr if that changes them."""
    return _noticed(study.identifiable(), study)


def with_dimensions(study: Study) -> Study:
    """The study as a run begins, all its offsets and compliances fitted; a notice goes to stderr if that changes it."""
    return _noticed(study.with_dimensions(), study)


def _noticed(study: Study, before: Study) -> Study:
    notice(*study.notices[len(before.notices) :])
    return study


def leave_out_poses(data: Measurements, text: str) -> Measurements:
    """The measurements without the poses of these numbers and ranges, as in `12,40-42`. Raises `LrmError`."""
    numbers: list[int] = []
    for word in filter(None, (part.strip() for part in text.split(","))):
        first, _, last = word.partition("-")
        if not (first.isdigit() and (last or first).isdigit()):
            raise LrmError(f"--leave-out {text}: '{word}' is no pose number; give numbers and ranges such as 12,40-42")
        if int(last or first) < int(first):
            raise LrmError(f"--leave-out {text}: '{word}' runs backwards; is {last}-{first} meant?")
        numbers += range(int(first), int(last or first) + 1)
    unknown = sorted(set(numbers) - {*data.pose.tolist(), *data.source.left_out})
    if unknown:
        raise LrmError(f"--leave-out {text}: {data.source.path.name} has no pose {unknown[0]}")
    if set(data.pose.tolist()) <= set(numbers):
        raise LrmError(f"--leave-out {text}: leaves none of the {len(data)} poses")
    return data.without(numbers) if numbers else data


def start_model(arm: Arm, model: Path | None) -> Model:
    """The nominal arm with the thesis's 45 parameters, or a fitted model of the same arm. Raises `FileError`."""
    if model is None:
        return nominal_model(arm)
    fitted = load_model(model)
    check_arm(model, fitted.arm, arm)
    return fitted


def check_arm(path: Path, model_arm: Arm, arm: Arm) -> None:
    """Raises `FileError` if the arm of a model file is not the one that is meant."""
    if model_arm != arm:
        differs = f", not of {arm.name}" if model_arm.name != arm.name else ": another arm file of that name"
        raise FileError(path, "arm", f"is a model of {model_arm.name}{differs}")


def read_measurements(
    path: Path,
    arm: Arm,
    arm_name: str,
    reading: Reading = AS_NAMED,
    usual: Reading | None = None,
    part: Part = every_pose,
) -> Measurements:
    """Measurements that the arm can have made; what a person should know of the file goes to stderr."""
    data = inputs.read_measurements(path, arm, arm_name, reading, usual, part)
    notice(*data.source.notices)
    return data


def read_poses(path: Path, arm: Arm, reading: Reading = AS_NAMED) -> Poses:
    """Commanded poses; what a person should know of the file goes to stderr. Raises `FileError`."""
    poses, table = load_pose_table(path, arm, reading)
    notice(*pose_doubts(table, arm, reading))
    return poses


def notice(*notices: str | Notice) -> None:
    """Tells a person something, one line each, on stderr."""
    for words in notices:
        log.print(f"notice: {words}", markup=False, highlight=False)


def one_of(what: str, name: str, names: Sequence[Name]) -> Name:
    """The one of the names that is meant. Raises `UnknownName`."""
    for allowed in names:
        if allowed == name:
            return allowed
    raise UnknownName(what, name, names)


@contextmanager
def progress(what: str) -> Iterator[OnProgress]:
    """A bar on stderr, on a terminal only."""
    with bars() as several:
        yield partial(several, what)


@contextmanager
def bars() -> Iterator[Progress]:
    """Bars on stderr for several parts of a work, on a terminal only."""
    with Bars(console=log, transient=True, disable=not animated()) as shown:
        tasks: dict[str, TaskID] = {}

        def tick(what: str, done: int, of: int) -> None:
            """Moves the bar of this name."""
            if what not in tasks:
                tasks[what] = shown.add_task(what, total=None)
            shown.update(tasks[what], completed=done, total=of or None)

        yield tick


@contextmanager
def pausing_bars() -> Iterator[tuple[Progress, Callable[[], None]]]:
    """Bars for a work that prints between its parts: the progress, and what clears them before something is printed."""
    with ExitStack() as stack:
        shown: list[Progress] = []

        def tick(what: str, done: int, of: int) -> None:
            """Moves the bar of this name, and shows the bars again if they were cleared."""
            if not shown:
                shown.append(stack.enter_context(bars()))
            shown[0](what, done, of)

        def pause() -> None:
            """Clears the bars."""
            shown.clear()
            stack.close()

        yield tick, pause


class TakesLonger(Exception):
    """A work that nobody asked for would take longer than it may: about `expected` s."""

    def __init__(self, expected: float) -> None:
        super().__init__(expected)
        self.expected = expected


@contextmanager
def timed(time: TimeOfParts, most: float | None) -> Iterator[Progress]:
    """Bars, or without a terminal one line with the time left, as soon as that is known of a part that is done.

    The progress raises `TakesLonger` as soon as the work turns out to take longer than `most` s.
    """
    told = False
    with bars() as shown:

        def tick(what: str, done: int, of: int) -> None:
            """Moves the bar, or prints a line; ends the work that takes too long."""
            nonlocal told
            shown(what, done, of)
            expected = time.expected(done, of)
            if done < of and most is not None and expected > most:
                raise TakesLonger(expected)
            if not told and 0 < done < of and not animated():
                notice(f"{what}: {done} of {of} done, about {in_minutes(time.left(done, of))} left")
                told = True

        yield tick
