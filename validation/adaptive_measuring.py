"""Adaptive measuring against random poses, on simulated arms: how many poses until the tip lands as near to its goals.

`python -m validation.adaptive_measuring --seeds 20`. A true arm is drawn by the seed as in `make demo`, with an effect
hidden in it; what is measured has the noise of the demo's tracker. A random plan of 120 poses is measured and
identified (`assess`: fit, then `auto`); its error at 300 goals that were never measured is the mark. Then poses are
chosen batch by batch (`design.adaptive_batch`) among 600 drawn in the same way, until the error at the goals is no
larger. Pure simulation of measuring, without daemon; fitting, diagnosing and choosing are the code of
`lrm-ident measure --until`.
Exit code 1 unless the median share of poses is at most a half.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from examples.demo.hidden import HiddenArm, hidden_arm
from examples.demo.pose_files import LOAD_G, clear_poses
from examples.demo.simulated_tracker import REST_SD_M
from examples.demo.world import ARM
from lrm_ident.data.measurements import Measurements
from lrm_ident.design.adaptive_batch import BATCH, FIRST_BATCH, AdaptiveFindings, assess, first_rows, next_rows
from lrm_ident.fitting.model_fit import nominal_model
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm as model_arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from validation.options import asked
from validation.synthetic import ArmDescription, load_arm, true_state
from validation.synthetic.example import ARM_FILE

RANDOM_POSES, OFFERED, GOALS, REPEAT_EVERY = 120, 600, 300, 8


@dataclass
class SimulatedRig:
    """An arm that is measured without moving anything. `measured`: rows of poses so far, repeats among them."""

    arm: Arm
    described: ArmDescription
    hidden: HiddenArm
    rng: np.random.Generator

    def true_tips(self, poses: Poses) -> Array:
        """(N, 3), m."""
        return np.asarray(true_state(self.described, self.hidden.truth, poses.q, poses.payload).tcp_m)

    def measure(self, poses: Poses, repeat_of: Sequence[int]) -> Measurements:
        """Poses with noise, numbered from 1; `repeat_of`: (N,), number of the pose that each repeats, or its own."""
        tips = self.true_tips(poses)
        noisy = tips + self.rng.normal(scale=REST_SD_M, size=tips.shape)
        number = np.arange(1, len(poses) + 1)
        return Measurements(
            poses, number, noisy, None, None, np.array(repeat_of), Path("simulated"), "", arm=self.arm, arm_name=ARM
        )

    def goal_error(self, model: Model, goals: Poses) -> float:
        """RMS distance (m) of the tip from goals: where the arm really is, at angles for which the model says goal."""
        return float(np.sqrt(((self.true_tips(goals) - solve_equilibrium(model, goals).tcp) ** 2).sum(axis=1).mean()))


def with_repeats(rows: Sequence[int]) -> tuple[list[int], list[int]]:
    """Rows with every eighth once more at the end, and the numbers that they repeat."""
    again = list(range(0, len(rows), REPEAT_EVERY))
    return [*rows, *(rows[k] for k in again)], [*range(1, len(rows) + 1), *(k + 1 for k in again)]


def drawn(arm: Arm, count: int, seed: Sequence[int]) -> Poses:
    """Random poses that keep clear, half of them with the load."""
    rng = np.random.default_rng(list(seed))
    return poses_of(clear_poses(arm, count, rng), np.where(np.arange(count) % 2, LOAD_G * 1e-3, 0.0))


def assessed(rig: SimulatedRig, every: Poses, rows: Sequence[int]) -> tuple[AdaptiveFindings, int]:
    """ModelReport from measuring some rows, and how many poses were measured."""
    again, of = with_repeats(rows)
    return assess(rig.measure(every.take(again), of)), len(again)


def random_run(rig: SimulatedRig, every: Poses, goals: Poses) -> tuple[float, int]:
    """Error at the goals (m) after a random plan, and its poses."""
    found, count = assessed(rig, every, range(RANDOM_POSES * REPEAT_EVERY // (REPEAT_EVERY + 1)))
    return rig.goal_error(found.model, goals), count


def adaptive_run(rig: SimulatedRig, every: Poses, goals: Poses, mark: float, seed: int) -> tuple[float, int]:
    """Error at the goals (m) as soon as it is no larger than a mark, and the poses that took."""
    rows = first_rows(nominal_model(rig.arm), None, every, FIRST_BATCH, seed).tolist()
    while True:
        found, count = assessed(rig, every, rows)
        error = rig.goal_error(found.model, goals)
        if error <= mark or count > RANDOM_POSES:
            return error, count
        left = np.setdiff1d(np.arange(len(every)), rows)
        rows += left[next_rows(found, every.take(rows), every.take(left), BATCH, seed)].tolist()


def main() -> int:
    """Prints one line a seed."""
    options = asked(__doc__, seeds=20, first=0)
    arm, described, shares = model_arm(ARM), load_arm(ARM_FILE), []
    print("| seed | hidden | random poses | error at goals mm | adaptive poses | error mm | share | s |")
    print("|---|---|---|---|---|---|---|---|")
    for seed in range(options.first, options.first + options.seeds):
        began = time.monotonic()
        rig = SimulatedRig(arm, described, hidden_arm(described, seed), np.random.default_rng([seed, 3]))
        goals = drawn(arm, GOALS, (seed, 4))
        mark, random = random_run(rig, drawn(arm, RANDOM_POSES, (seed, 5)), goals)
        error, count = adaptive_run(rig, drawn(arm, OFFERED, (seed, 6)), goals, mark, seed)
        shares.append(count / random if error <= mark else np.inf)  # inf: not even with as many
        figures = [f"{mark * 1e3:.2f}", str(count), f"{error * 1e3:.2f}", f"{shares[-1]:.2f}"]
        cells = [str(seed), rig.hidden.effect, str(random), *figures, f"{time.monotonic() - began:.0f}"]
        print("|", " | ".join(cells), "|", flush=True)
    median = float(np.median(shares))
    print(f"median share of poses: {median:.2f}; at most a half in {np.sum(np.array(shares) <= 0.5)} of {len(shares)}")
    return int(median > 0.5)


if __name__ == "__main__":
    sys.exit(main())
