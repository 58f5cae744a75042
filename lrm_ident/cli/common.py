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

from lrm_ident.data.apply_reading import AS_NAMED
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements, metadata_of
from lrm_ident.effect_plugins import Catalogue, catalogue_with, file_of, sha256_of
from lrm_ident.estimation.identifiability import fit_identifiable
from lrm_ident.estimation.loss import SQUARED, Loss, loss_named
from lrm_ident.progress import OnProgress
from lrm_ident.registration.checked import load_checked
from lrm_ident.report.document import Block, Document, ResultTable, write
from lrm_ident.report.fit import fit_words
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.errors import FileError, LrmError, UnknownName
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import ModelFile, arm_of, load_model, to_model
from lrm_math.model.reading import Reading
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
    """A model file, as it stands and as a model; a notice if its own effects have changed since it was fitted."""
    file = read_toml(path, ModelFile)
    model = to_model(path, file, arm_of(path, file.arm), catalogue)
    own, known = file_of(model.effects), file.provenance
    if own and known and known.effects_sha256 not in (None, sha256_of(own)):
        log.print(f"notice: {own} is not the file that {path.name} was fitted with (its SHA-256 differs)")
    return file, model


def read_inputs(
    model: Path, data: Path, effects_file: Path | None, reading: Reading = AS_NAMED
) -> tuple[ModelFile, Model, Measurements, Catalogue]:
    """A model file, its model, measurements of its arm read as those of its fit, and the effects that are known."""
    catalogue = catalogue_with(effects_file)
    file, loaded = read_model(model, catalogue)
    usual = None if file.provenance is None else file.provenance.reading
    measured = read_measurements(data, loaded.arm, file.arm, reading, usual)
    if file.provenance is None:
        return file, loaded, measured, catalogue
    if file.provenance.data_sha256 == measured.sha256:
        measured = measured.without(file.provenance.left_out)
    if how := fit_words(file.provenance.loss, measured.left_out):
        log.print(f"notice: as in the model's fit: {how}")
    return file, loaded, measured, catalogue


def read_identifiable(
    model: Path, data: Path, effects_file: Path | None, reading: Reading = AS_NAMED
) -> tuple[ModelFile, Model, Measurements, Catalogue]:
    """The same with a model whose free parameters the data alone identify, whatever a prior decided in the fit."""
    file, loaded, measured, catalogue = read_inputs(model, data, effects_file, reading)
    if file.provenance is None or file.provenance.prior is None:
        return file, loaded, measured, catalogue
    fitted = fit_identifiable(loaded, measured, loaded.free, loss_of(file)).fit.model
    log.print(
        f"notice: the model was fitted with the prior '{file.provenance.prior}'; this goes on with the "
        f"{len(fitted.free)} of its {len(loaded.free)} parameters that the data can tell without it"
    )
    return file, fitted, measured, catalogue


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


def loss_of(file: ModelFile) -> Loss:
    """The loss of a model's last fit; least squares where the file does not say."""
    return SQUARED if file.provenance is None else loss_named(file.provenance.loss)


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
    """Measurements that the arm can have made; what a person should know of the file goes to stderr.

    Args:
        reading: how the numbers are read; where it and the file beside them say nothing, as `usual` says.
    """
    data = load_checked(path, arm, reading, usual)
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
