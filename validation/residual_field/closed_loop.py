"""`python -m validation.residual_field.closed_loop`: where the tip lands with a field and without, on unfamiliar arms.

The loop of the demo without its servo board: an arm with two effects that the catalogue does not have, by the
independent generator, is measured, fitted and named; a field is added; the inverse of each model commands goals
that were never measured, and the true arm says where its tip lands. Exit code 1 unless it is nearer with the field.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.measuring.verification.goals import draw_goals
from lrm_ident.study.field_step import NoBetterPrediction
from lrm_ident.study.study import Study
from lrm_math.arm import arm_file
from lrm_math.arrays import Array
from lrm_math.ik.answer import Solved
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.goal import point
from lrm_math.model.deployed_model import of_a_session
from lrm_math.model.model import Model
from validation.hidden_effects.case import Case, together
from validation.hidden_effects.cases import OUTSIDE
from validation.hidden_effects.data import ARM_FILE, true_arm, write_case
from validation.options import asked
from validation.synthetic import load_arm, true_state

POSES, GOALS = 400, 50


@dataclass(frozen=True)
class LoopOutcome:
    """RMS distance (m) from goals with the plain fit and with what `auto` names: each without a field and with it, by
    the tool's own choice whether to add it.

    `missed`: goals that some model has no command for, left out of all.
    """

    seed: int
    hidden: str
    plain: tuple[float, float]
    named: tuple[float, float]
    missed: int

    @property
    def words(self) -> str:
        """One row of the table."""
        figures = (f"{1e3 * error:.2f}" for error in (*self.plain, *self.named))
        return f"| {self.seed} | {self.hidden} | {' | '.join(figures)} | {self.missed} |"


def unfamiliar(seed: int) -> Case:
    """Two effects that are in no catalogue, by the seed."""
    pairs = list(combinations(OUTSIDE.values(), 2))
    return together(*pairs[seed % len(pairs)])


def closed_loop(seed: int, poses: int) -> LoopOutcome:
    """One arm, by the seed, measured at so many poses."""
    case = unfamiliar(seed)
    with tempfile.TemporaryDirectory(prefix="loop-") as folder:
        data = load_measurements(write_case(case, seed, poses, Path(folder)), arm_file.load_arm("lrm-lab"))
    plain = Study.of(data).fit()
    _, named = plain.auto()
    studies = (plain, _with_field(plain), named, _with_field(named))
    commands = [_commands(study.model, draw_goals(study.model.arm, GOALS, seed)) for study in studies]
    known = np.isfinite(np.stack(commands)).all(axis=(0, 2))
    goals = draw_goals(plain.model.arm, GOALS, seed)[known]
    a, b, c, d = (_rms(_landed(case, seed, q[known]) - goals) for q in commands)
    return LoopOutcome(seed, case.name, (a, b), (c, d), int((~known).sum()))


def _with_field(study: Study) -> Study:
    try:
        return study.add_field()
    except NoBetterPrediction:
        return study


def _commands(model: Model, goals: Array) -> Array:
    """(N, n), rad, the first branch from the home pose; NaN where there is none."""
    solver, home = CalibratedSolver.of(model, left_out=_of_sessions(model)), (0.0,) * model.arm.dof
    out = np.full((len(goals), model.arm.dof), np.nan)
    for row, goal in enumerate(goals.tolist()):
        reply = solver.solve(point(goal), near=home)
        if isinstance(reply, Solved):
            out[row] = reply.q
    return out


def _of_sessions(model: Model) -> list[str]:
    return sorted({effect.id for effect in model.effects if of_a_session(effect)})


def _landed(case: Case, seed: int, q: Array) -> Array:
    """(N, 3), m, where the true tip is at commands, without a load."""
    arm = load_arm(ARM_FILE)
    return np.asarray(true_state(arm, true_arm(case, seed, arm), q).tcp_m)


def _rms(error: Array) -> float:
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def main() -> int:
    """Prints one line a seed."""
    known, nearer = asked(__doc__, seeds=10, poses=POSES), 0
    print("| seed | hidden | fit mm | and field | named mm | and field | goals without a command |")
    print("|---|---|---|---|---|---|---|")
    for seed in range(known.seeds):
        one = closed_loop(seed, known.poses)
        nearer += one.named[1] < one.named[0]
        print(one.words, flush=True)
    print(f"nearer with a field than with names alone: {nearer} of {known.seeds}")
    return int(nearer < known.seeds)


if __name__ == "__main__":
    sys.exit(main())
