"""What all commands share: the application, the two consoles, careful reading, progress."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.console import Console
from rich.progress import Progress

from lrm_ident.data.measurements import Measurements, load_measurements, metadata_of
from lrm_ident.effect_plugins import Catalogue
from lrm_ident.fit.identifiability import fit_identifiable
from lrm_ident.progress import Tick
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import FileError
from lrm_math.model.model import Model
from lrm_math.model.model_file import ModelFile, arm_of, to_model
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


def read_model(path: Path, catalogue: Catalogue) -> tuple[ModelFile, Model]:
    """A model file, as it stands and as a model."""
    file = read_toml(path, ModelFile)
    return file, to_model(path, file, arm_of(path, file.arm), catalogue)


def arm_for(data: Path, arm: str | None) -> tuple[str, Arm]:
    """The arm that is named, or that the file beside the data names. Raises `FileError`."""
    if arm is not None:
        return arm, load_arm(arm)
    metadata = metadata_of(data) if data.exists() else None
    if not data.exists():
        raise FileError(data, "", "no such file")
    if metadata is None or metadata.arm is None:
        raise FileError(data, "", "no arm given", "name it with --arm, or as arm in the .toml file beside the data")
    return metadata.arm, load_arm(metadata.arm)


def read_measurements(path: Path, arm: Arm, arm_name: str) -> Measurements:
    """Measurements of an arm; what a person should know of the file goes to stderr."""
    data = load_measurements(path, arm)
    for notice in data.notices:
        log.print(f"notice: {path.name}: {notice}")
    metadata = metadata_of(path)
    if metadata and metadata.arm and metadata.arm != arm_name:
        log.print(f"notice: {path.name} was measured on {metadata.arm}, the model is of {arm_name}")
    return data


def told_by_data(file: ModelFile, model: Model, data: Measurements) -> Model:
    """A model whose free parameters the data alone can tell: the model itself unless a prior decided some of them."""
    if file.provenance is None or file.provenance.prior is None:
        return model
    told = fit_identifiable(model, data, model.free).fit.model
    log.print(
        f"notice: the model was fitted with the prior '{file.provenance.prior}'; this goes on with the "
        f"{len(told.free)} of its {len(model.free)} parameters that the data can tell without it"
    )
    return told


@contextmanager
def progress(what: str) -> Iterator[Tick]:
    """A bar on stderr, on a terminal only."""
    with Progress(console=log, transient=True, disable=not log.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)
