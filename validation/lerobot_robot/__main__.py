"""`python -m validation.lerobot_robot`: three hidden effects, three seeds; needs LeRobot and the plug-in installed."""

from __future__ import annotations

import tempfile
from pathlib import Path

from examples.so101.hidden_arm import HIDDEN
from validation.lerobot_robot.closed_loop import TipErrors, closed_loop
from validation.runner import run_cases
from validation.tables import markdown_table, table_row

SEEDS = (1, 2, 3)


def examine(case: tuple[str, int]) -> TipErrors:
    """The errors with an effect and a seed."""
    with tempfile.TemporaryDirectory(prefix="lrm-") as folder:
        return closed_loop(*case, Path(folder))


def row(key: str, found: TipErrors) -> tuple[str, ...]:
    """A line of the table."""
    numbers = [1e3 * error for error in (found.without, found.calibrated, found.floor)]
    ratio, seen = found.calibrated / found.floor, 57.29578 * found.observed
    return *key.split(", "), *(f"{number:.2f}" for number in (*numbers, ratio, seen))


def main() -> None:
    """Prints a table."""
    cases = {f"{effect}, {seed}": (effect, seed) for effect in HIDDEN for seed in SEEDS}
    found = run_cases(cases, examine, lambda *of: table_row(row(*of)))
    head = ("without (mm)", "calibrated (mm)", "perfect (mm)", "ratio", "observed off wish (deg)")
    print(markdown_table(("hidden", "seed", *head), [row(*of) for of in found.items()]))


if __name__ == "__main__":
    main()
