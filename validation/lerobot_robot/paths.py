"""`python -m validation.lerobot_robot.paths`: 10 000 random paths over fitted models of three arms; needs no LeRobot.

Each model is fitted to simulated measurements of a hidden arm (`fitted_arms`), which shares no code with it. Rests are
those of the hidden arm at the ends of some paths: with the wish itself sent, corrected without bounds, and bounded.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from validation.lerobot_robot.continuity import PathFigures, figures, follow, followed_without_bounds, random_path
from validation.lerobot_robot.fitted_arms import FittedArm, fitted_arms
from validation.options import Count, asked
from validation.runner import run_cases
from validation.tables import markdown_table, table_row

ARMS = ("so101", "lrm-rover", str(Path(__file__).parents[1] / "hidden_effects" / "arms" / "seven-joint.toml"))
RESTS = 10
"""The true arm is asked at the end of every tenth path: that takes longer than the path."""


COLUMNS = (
    *("arm", "models", "paths", "commands", "ratio", "of joints without direction"),
    *("largest step (deg)", "farthest (deg)", "bound bit"),
    *("rests (mm): wish sent, RMS", "median", "90 %", "worst"),
    *(f"{way}, {what}" for way in ("no bounds", "bounded") for what in ("RMS", "median", "90 %", "worst")),
)


def main() -> None:
    """Prints a row for each arm."""
    chosen = asked(
        __doc__,
        models=(Count(200), "of all arms together"),
        paths=(Count(10_000), "of all arms together"),
        arm=([*ARMS], "only these", ARMS),
        jobs=1,
    )
    models = -(-chosen.models // len(ARMS))
    each = -(-chosen.paths // (len(ARMS) * models))
    found = run_cases({name: name for name in chosen.arm}, partial(followed, models, each), _line, chosen.jobs)
    rows = [(Path(name).stem, models, models * each, *row(one)) for name, one in found.items()]
    print(markdown_table(COLUMNS, rows))


def followed(models: int, each: int, arm: str) -> PathFigures:
    """Figures of so many models of an arm, with so many paths each."""
    rng, found = np.random.default_rng(57), PathFigures()
    for fitted in fitted_arms(arm, models):
        for number in range(each):
            _follow(fitted, rng, found, number % RESTS == 0)
    return found


def row(found: PathFigures) -> tuple[object, ...]:
    """Cells of the figures."""
    angles = (f"{np.degrees(x):.1f}" for x in (found.largest_step, found.farthest))
    rests = (cell for errors in (found.without, found.unbounded, found.left) for cell in figures(errors))
    return found.steps, f"{found.ratio:.1f}", f"{found.undirected_ratio:.2f}", *angles, found.bounded, *rests


def _line(arm: str, found: PathFigures) -> str:
    return table_row((Path(arm).stem, *row(found)))


def _follow(fitted: FittedArm, rng: np.random.Generator, found: PathFigures, rests: bool) -> None:
    """One random path, and the rest at its end."""
    low, high = fitted.correction.limits
    path = random_path(low, high, rng)
    commands = follow(fitted.correction, path, found)
    unbounded = followed_without_bounds(fitted.correction, path) if rests else None
    if unbounded is None:
        return
    for errors, sent in ((found.without, path), (found.unbounded, unbounded), (found.left, commands)):
        errors.append(fitted.missed_mm(path[-1], sent))


if __name__ == "__main__":
    main()
