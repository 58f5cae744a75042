"""What a data set cannot show, whatever is done with it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_math.arrays import Array
from lrm_math.effects.base import FEW_REVERSALS, Evidence

FEW_LEVELS, RUNS_WITH = 4, 0.8


def audit(data: Measurements, torque: Array) -> tuple[str, ...]:
    """Traps in the data, one sentence each, worst for the identification first. `torque`: (N, n), N·m."""
    traps = (_levels(data, torque), _order(data), _reversals(data, torque), _signs(data, torque), _loads(data))
    return tuple(sentence for kind in traps for sentence in kind)


def _levels(data: Measurements, torque: Array) -> Iterator[str]:
    seen = Evidence(data.poses, torque)
    few = {i + 1: seen.levels(i) for i in range(torque.shape[1]) if seen.levels(i) <= FEW_LEVELS}
    if few:
        least, most = min(few.values()), max(few.values())
        levels = f"{least}" if least == most else f"{least} to {most}"
        yield (
            f"few levels: {_joints(few)} stand at {levels} angles only, so servo "
            "gain, eccentricity and a cable's pull on them look alike; measure five or more"
        )


def _order(data: Measurements) -> Iterator[str]:
    order = np.arange(len(data))
    for i in range(data.poses.q.shape[1]):
        q = data.poses.q[:, i]
        if np.ptp(q) > 0:
            correlation = float(np.corrcoef(order, q)[0, 1])
            if abs(correlation) > RUNS_WITH:
                yield (
                    f"order: the poses run with joint {i + 1} (correlation {correlation:.2f}), so a drift and an error "
                    "of that joint look alike; measure in random order"
                )


def _reversals(data: Measurements, torque: Array) -> Iterator[str]:
    if data.poses.direction is None:
        return
    seen = Evidence(data.poses, torque)
    never = [i + 1 for i in range(torque.shape[1]) if seen.reversals(i) < FEW_REVERSALS]
    if never:
        yield f"no reversal: {_joints(never)} (nearly) never turned round, so hysteresis there cannot show"


def _signs(data: Measurements, torque: Array) -> Iterator[str]:
    seen = Evidence(data.poses, torque)
    same = [i + 1 for i in range(torque.shape[1]) if not seen.both_signs(torque[:, i])]
    if same:
        yield f"one-sided torque: gravity pulls {_joints(same)} to one side only; their play cannot show"


def _loads(data: Measurements) -> Iterator[str]:
    if len(np.unique(data.poses.payload)) == 1:
        yield "one load only: a spring that stiffens, play, and wrong masses are hard to tell apart; measure with two"


def _joints(numbers: object) -> str:
    names = [str(number) for number in numbers]  # type: ignore[attr-defined]
    return f"joint {names[0]}" if len(names) == 1 else f"joints {', '.join(names[:-1])} and {names[-1]}"
