"""README's table of real arms, from the result of the proof: README names the columns, all numbers are the file's."""

from __future__ import annotations

import re
from pathlib import Path

from validation.commit import ROOT
from validation.proofs.result_file import FOLDER, ProofResult, read

README = ROOT / "README.md"
RESULT = FOLDER / "real-arms.json"
HEAD = (
    "| arm, measurements | nominal | rigid errors only | fit with springs | with added effects |\n|---|---|---|---|---|"
)


def readme() -> dict[Path, str]:
    """README's text with the rows of its table made anew; nothing where the result is not there."""
    return {README: with_rows(README.read_text(encoding="utf-8"), read(RESULT))} if RESULT.exists() else {}


def with_rows(text: str, result: ProofResult) -> str:
    """The text with the rows under `HEAD` made anew: errors as deployed, mm RMS, largest nominal error first.

    Raises `ValueError` if there is no such table.
    """
    before, head, after = text.partition(f"{HEAD}\n")
    if not head:
        raise ValueError(f"there should be a table that begins with {HEAD.splitlines()[0]}")
    return before + head + "".join(_rows(result)) + re.sub(r"\A(\|.*\n)*", "", after)


def _rows(result: ProofResult) -> list[str]:
    arm, poses, deployed = map(result.columns.index, ("arm", "poses", "as deployed, mm RMS"))
    errors: dict[str, list[float]] = {}
    for row in result.rows:
        errors.setdefault(f"{row[arm]}, {row[poses]} poses", []).append(float(str(row[deployed])))
    return [_row(name, of) for name, of in sorted(errors.items(), key=lambda line: -line[1][0])]


def _row(name: str, errors: list[float]) -> str:
    *others, last = (f"{one:.3g}" for one in errors)
    return f"| {name} | {' | '.join(others)} | **{last}** |\n"
