"""The command `fleet`: many arms of one kind, and what they have in common."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import progress, publish, show
from lrm_ident.data.atomic_write import check_replaceable, write_bytes, write_text
from lrm_ident.fitting.executors import executor_for
from lrm_ident.fleet.fleet_prior import FleetKnowledge, prior_text
from lrm_ident.fleet.fleet_report import fleet_document, fleet_result, table_csv, table_parquet
from lrm_ident.fleet.manifest import read_manifest
from lrm_ident.fleet.run_fleet import MODELS, run_fleet
from lrm_ident.workbench.fleet_page import fleet_page

WRITTEN = ("fleet.csv", "fleet.parquet", "fleet.html", "prior.toml")


@command
def fleet(
    manifest: Annotated[
        Path, Argument(metavar="MANIFEST", help="A CSV, one row per arm: data, arm, name; other columns are tags.")
    ],
    results: Annotated[
        Path, Option("-o", "--output", metavar="FOLDER", help="Folder for the results; created if it does not exist.")
    ],
    cluster: arg.Cluster = None,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
) -> None:
    """Identify many arms of one kind, each as by auto, and compare them.

    Writes a model per arm, one table (CSV, and Parquet where pyarrow is installed), a page, and a prior file for the
    next arm. Started again it goes on where it was; a broken data set is a row with its reason.
    """
    for name in WRITTEN:
        check_replaceable(results / name)
    members = read_manifest(manifest)
    with executor_for(cluster, most=len(members)) as pool, progress(f"identifying {len(members)} arms") as tick:
        records = run_fleet(members, results, pool, tick)
    result = fleet_result(members, records, results / MODELS)
    document = fleet_document(result)
    publish(document, json, in_full=show_all)
    write_text(results / "fleet.csv", table_csv(result))
    parquet = table_parquet(result)
    if parquet is not None:
        write_bytes(results / "fleet.parquet", parquet)
    write_text(results / "fleet.html", fleet_page(result, manifest.name))
    written = "models/, fleet.csv, fleet.html" + (", fleet.parquet" if parquet is not None else "")
    if isinstance(result.known, FleetKnowledge):
        source = f"{result.known.arms} arms of {manifest.name}, lrm-ident fleet"
        write_text(results / "prior.toml", prior_text(result.known, f"fleet {manifest.stem}", source))
        written += ", prior.toml"
    show(f"Written to {results}: {written}")
