"""What all commands share: the application, the consoles, reading of inputs, and the one writer of results."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import typer
from rich.console import Console
from rich.progress import Progress

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements, load_measurements, metadata_of
from lrm_ident.effect_plugins import Catalogue, catalogue_with
from lrm_ident.estimation.identifiability import fit_identifiable
from lrm_ident.progress import OnProgress
from lrm_ident.report.document import Block, Document, ResultTable, write
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.errors import FileError, LrmError, UnknownName
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import ModelFile, arm_of, load_model, to_model
from lrm_math.toml_file import read_toml

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Identify the model of a robot arm from measured TCP positions, see where it fails, find what is missing.\n\n"
    "Start with: lrm-ident fit DATA.csv --arm lrm-lab -o model.toml, then lrm-ident diagnose model.toml DATA.csv",
)
out = Console(width=None if sys.stdout.isatty() else 100)
log = Console(stderr=True)
Name = TypeVar("Name", bound=str)


def show(*blocks: Block) -> None:
    """Prints text and tables."""
    write(out, blocks)


def publish(
    result: Document, json: Path | None, figure: Path | None = None, draw: Callable[[Path], None] | None = None
) -> None:
    """Prints a result, then writes its JSON file, its figure, and the numbers behind the figure."""
    show(*result.blocks)
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
    if behind is not None and behind in others:
        raise FileError(behind, "", f"is where the numbers behind {figure} go", "give the two files different names")


def read_model(path: Path, catalogue: Catalogue) -> tuple[ModelFile, Model]:
    """A model file, as it stands and as a model."""
    file = read_toml(path, ModelFile)
    return file, to_model(path, file, arm_of(path, file.arm), catalogue)


def read_inputs(model: Path, data: Path, effects_file: Path | None) -> tuple[ModelFile, Model, Measurements, Catalogue]:
    """A model file, its model, measurements of its arm, and the effects that are known."""
    catalogue = catalogue_with(effects_file)
    file, loaded = read_model(model, catalogue)
    return file, loaded, read_measurements(data, loaded.arm, file.arm), catalogue


def read_identifiable(
    model: Path, data: Path, effects_file: Path | None
) -> tuple[ModelFile, Model, Measurements, Catalogue]:
    """The same with a model whose free parameters the data alone identify, whatever a prior decided in the fit."""
    file, loaded, measured, catalogue = read_inputs(model, data, effects_file)
    if file.provenance is None or file.provenance.prior is None:
        return file, loaded, measured, catalogue
    fitted = fit_identifiable(loaded, measured, loaded.free).fit.model
    log.print(
        f"notice: the model was fitted with the prior '{file.provenance.prior}'; this goes on with the "
        f"{len(fitted.free)} of its {len(loaded.free)} parameters that the data can tell without it"
    )
    return file, fitted, measured, catalogue


def start_model(arm: Arm, model: Path | None) -> Model:
    """The nominal arm with the thesis's 45 parameters, or a fitted model of the same arm. Raises `FileError`."""
    if model is None:
        return model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))
    fitted = load_model(model)
    if fitted.arm != arm:
        raise FileError(model, "arm", f"is a model of {fitted.arm.name}, not of {arm.name}")
    return fitted


def read_measurements(path: Path, arm: Arm, arm_name: str) -> Measurements:
    """Measurements of an arm; what a person should know of the file goes to stderr."""
    data = load_measurements(path, arm)
    for notice in data.notices:
        log.print(f"notice: {path.name}: {notice}")
    metadata = metadata_of(path)
    if metadata and metadata.arm and metadata.arm != arm_name:
        log.print(f"notice: {path.name} was measured on {metadata.arm}, the model is of {arm_name}")
    return data


def error_of(model: Model, data: Measurements) -> ErrorStats:
    """TCP error of a model as it is."""
    return error_stats(data.tcp - equilibrium(model, data.poses).tcp)


def nominal_error(arm: Arm, data: Measurements) -> ErrorStats:
    """TCP error of the arm file's nominal arm."""
    return error_of(model_of(arm, ()), data)


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
