"""The texts of a checkout: its pages, the help of its commands, and what its commands print on the shipped example."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from validation.readability.prose import Sentence, sentences

PROBE = Path(__file__).with_name("help_probe.py")
EXAMPLE = Path("lrm_ident", "data", "examples", "hidden-play.csv")
OUTPUTS = (
    "fit DATA.csv -o model.toml",
    "compare model.toml DATA.csv",
    "diagnose model.toml DATA.csv",
    "add model.toml DATA.csv backlash@joint2 -o better.toml",
    "diagnose better.toml DATA.csv",
    "auto model.toml DATA.csv -o best.toml --no-nested --max-effects 1",
    "fit FEW.csv -o few.toml",
    "diagnose few.toml FEW.csv",
)
"""What a user sees first: a cause that is found, nothing missing, too few poses to distinguish causes."""


def pages(tree: Path) -> list[Sentence]:
    """README and `docs/*.md`, without decisions and generated proofs."""
    files = [tree / "README.md", *sorted((tree / "docs").glob("*.md"))]
    return [each for path in files for each in page(path, path.relative_to(tree).as_posix())]


def page(path: Path, name: str) -> list[Sentence]:
    """Sentences of one page."""
    return sentences(path.read_text(encoding="utf-8"), name)


def helps(tree: Path) -> list[Sentence]:
    """Help of every command, argument and option, from the code of the checkout."""
    return of_helps(json.loads(run(tree, [sys.executable, str(PROBE)], tree)))


def of_helps(texts: Iterable[tuple[str, str]]) -> list[Sentence]:
    """Sentences of help texts, by the name of each command or option."""
    return [each for name, text in texts for each in sentences(text, name)]


def verdicts(tree: Path) -> list[Sentence]:
    """What the first commands print on the shipped example, whole and its first 40 poses; lines are those of stdout."""
    found: list[Sentence] = []
    with tempfile.TemporaryDirectory() as folder:
        lay_out(tree / EXAMPLE, Path(folder))
        for words in OUTPUTS:
            text = run(tree, [sys.executable, "-m", "lrm_ident", *words.split()], Path(folder))
            found += sentences(unindented(text), words)
    return found


def unindented(text: str) -> str:
    """Each line that is indented deeper or begins a table is a block of its own, and none is taken for code."""
    return "\n\n".join(" ".join(line.split()) for line in text.splitlines() if line.strip("─ "))


def lay_out(data: Path, folder: Path) -> None:
    """Measurements as DATA.csv, and their first 40 poses as FEW.csv."""
    lines = data.read_text(encoding="utf-8").splitlines()
    beside = data.with_suffix(".toml").read_text(encoding="utf-8")
    for name, rows in (("DATA", lines), ("FEW", lines[:41])):
        (folder / f"{name}.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
        (folder / f"{name}.toml").write_text(beside, encoding="utf-8")


def run(tree: Path, command: list[str], folder: Path) -> str:
    """Stdout of a command of that checkout, which must succeed."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tree), *sys.path]), "COLUMNS": "400"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {done.returncode}: {done.stderr}")
    return done.stdout
