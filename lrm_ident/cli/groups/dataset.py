"""The group `dataset`: measurements as a data set that others can use."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command_group, command_of
from lrm_ident.cli.common import publish, read_measurements
from lrm_ident.data.measurement_file.conventions import arm_for, metadata_of
from lrm_ident.report.dataset import dataset_document, dataset_faults
from lrm_math.errors import FileError
from lrm_math.model.reading import AS_NAMED

group = command_group("dataset", "Check measurements that others are to use.")


@command_of(group)
def check(
    file: Annotated[Path, Argument(metavar="FILE", help="The measurements: NAME.csv, with NAME.toml beside it.")],
    arm: arg.ArmName = None,
    json: arg.JsonFile = None,
) -> None:
    """Check that others can use a data set: table, metadata and card (docs/dataset.md).

    Exit code 2 if something is missing.

    \b
      lrm-ident dataset check DATA.csv
      lrm-ident dataset check DATA.csv --arm so101 --json check.json
    """
    name, described = arm_for(file, arm)
    data, metadata = read_measurements(file, described, name, AS_NAMED), metadata_of(file)
    faults = dataset_faults(data, metadata)
    publish(dataset_document(data, metadata.card if metadata else None, faults), json)
    if faults:
        rights = f"add them to {file.with_suffix('.toml').name}, see docs/dataset.md"
        raise FileError(file, "", f"not complete: {', '.join(faults)}", rights)
