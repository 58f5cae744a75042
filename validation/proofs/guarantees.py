"""`python -m validation.proofs.guarantees`: runs the tests that hold each guarantee of the daemon.

Which tests hold which guarantee is said in guarantees.toml beside this file.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import tomllib
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from validation.commit import ROOT
from validation.options import asked
from validation.proofs.result_file import FOLDER, computed, write

NAME = "guarantees.json"
STATED = Path(__file__).with_name("guarantees.toml")
COLUMNS = ("guarantee", "where", "tests", "passed", "failed", "skipped", "held by")


@dataclass(frozen=True)
class Guarantee:
    """A sentence on the daemon, the part that keeps it, and the tests that hold it (`FILE::NAME`)."""

    says: str
    where: str
    tests: tuple[str, ...]


def guarantees() -> tuple[Guarantee, ...]:
    """All of them, as stated."""
    stated = tomllib.loads(STATED.read_text(encoding="utf-8"))["guarantee"]
    return tuple(Guarantee(one["says"], one["where"], tuple(one["tests"])) for one in stated)


def ran(tests: tuple[str, ...]) -> dict[str, Counter[str]]:
    """How often each test passed, failed or was skipped, with all its parameters."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.xml")
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"--junit-xml={report}", *tests]
        subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, stdout=sys.stderr)
        cases = ET.parse(report).getroot().iter("testcase")
        found: dict[str, Counter[str]] = {}
        for case in cases:
            name = f"{case.get('classname', '').replace('.', '/')}.py::{case.get('name', '').partition('[')[0]}"
            kinds = {part.tag for part in case}
            result = "failed" if kinds & {"failure", "error"} else "skipped" if "skipped" in kinds else "passed"
            found.setdefault(name, Counter())[result] += 1
    return found


def main() -> None:
    """Writes the result."""
    options = asked(__doc__, out=FOLDER / NAME)
    stated = guarantees()
    found = ran(tuple(dict.fromkeys(test for one in stated for test in one.tests)))
    rows = []
    for one in stated:
        counts: Counter[str] = sum((found.get(test, Counter()) for test in one.tests), Counter())
        numbers = [counts[kind] for kind in ("passed", "failed", "skipped")]
        rows.append((one.says, one.where, sum(numbers), *numbers, list(one.tests)))
    write(options.out, computed(COLUMNS, rows))


if __name__ == "__main__":
    main()
