"""File of one proof: a table that a command computed, with that command, the day, the commit and the machine."""

from __future__ import annotations

import json
import math
import os
import platform
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from validation.commit import COMMIT, ROOT

FOLDER = ROOT / "docs" / "proofs"
SCHEMA = "lrm/proof/1"


@dataclass(frozen=True)
class ProofResult:
    """Rows of a table (`columns` name their units), and how they came about."""

    columns: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]
    command: str
    date: str
    commit: str
    machine: str


def computed(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> ProofResult:
    """A result of the command that runs now."""
    words = Path(sys.modules["__main__"].__spec__.name if sys.modules["__main__"].__spec__ else sys.argv[0]).name
    command = " ".join(["python -m", words.removesuffix(".__main__"), *map(_without_folders, sys.argv[1:])])
    return ProofResult(tuple(columns), tuple(map(tuple, rows)), command, time.strftime("%Y-%m-%d"), COMMIT, _machine())


def write(path: Path, result: ProofResult) -> None:
    """Writes the file, and makes its folder; a number that JSON lacks is null. Needs the standard library alone."""
    path.parent.mkdir(parents=True, exist_ok=True)
    values = {"schema": SCHEMA, **asdict(result), "rows": [[*map(_finite, row)] for row in result.rows]}
    path.write_text(json.dumps(values, indent=1, ensure_ascii=False, allow_nan=False) + "\n", "utf-8")
    print(f"{path.name}: {len(result.rows)} rows")


def _finite(cell: object) -> object:
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


def read(path: Path) -> ProofResult:
    """Reads a file. Raises `ValueError` if it is none of a proof."""
    values = json.loads(path.read_text(encoding="utf-8"))
    if values.pop("schema", None) != SCHEMA:
        raise ValueError(f"{path}: should be of the schema {SCHEMA}")
    rows = tuple(map(tuple, values.pop("rows")))
    return ProofResult(columns=tuple(values.pop("columns")), rows=rows, **values)


def _machine() -> str:
    load = f", load {os.getloadavg()[1]:.1f}" if hasattr(os, "getloadavg") else ""  # of five minutes
    alone = ", at real-time priority" if getattr(os, "sched_getscheduler", int)(0) else ""
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores{load}{alone}"
    return f"{machine}, Python {platform.python_version()}"


def _without_folders(word: str) -> str:
    return Path(word).name if os.sep in word else word
