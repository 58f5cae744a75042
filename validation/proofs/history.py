"""History of speed and soak, a line for each run: `python -m validation.proofs.history out/speed.json --soak success`.

A line has the ratios of one run, a peer's time over ours, so that lines of machines of different speed can be compared.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from validation.proofs.result_file import FOLDER, ProofResult, computed, read, write

FIRST = ("date", "commit", "soak")
OURS = "lrm_math"


def line_of(speed: ProofResult, soak: str) -> dict[str, object]:
    """One line of the history: how the soak ended, and the ratio to each peer that this run had."""
    at = {name: speed.columns.index(name) for name in ("what", "by", "ratio")}
    peers = (row for row in speed.rows if not str(row[at["by"]]).startswith(OURS))
    ratios = {f"{row[at['what']]}: {row[at['by']]}": row[at["ratio"]] for row in peers}
    return {**dict(zip(FIRST, (speed.date, speed.commit, soak), strict=True)), **ratios}


def continued(history: ProofResult | None, line: dict[str, object]) -> ProofResult:
    """The history with one more line; a peer that a line does not have is None there. A commit has one line a day."""
    lines = [dict(zip(history.columns, row, strict=True)) for row in history.rows] if history else []
    kept = [one for one in lines if (one["date"], one["commit"]) != (line["date"], line["commit"])]
    columns = list(dict.fromkeys(name for one in [*kept, line] for name in one))
    return computed(columns, [[one.get(name) for name in columns] for one in [*kept, line]])


def main() -> None:
    """Adds a line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("speed", type=Path, help="what `python -m bench --json` wrote")
    parser.add_argument("--soak", default="not run", help="how `make soak` ended: success or failure")
    parser.add_argument("--history", type=Path, default=FOLDER / "history.json")
    given = parser.parse_args()
    before = read(given.history) if given.history.exists() else None
    write(given.history, continued(before, line_of(read(given.speed), given.soak)))


if __name__ == "__main__":
    main()
