"""`python -m validation.predicted_error`: does `verify` predict the error that a tracker measures at goals?

SO-101s of `examples.so101.hidden_arm`, each with one hidden effect, are measured at the poses that `lrm-ident design
so101 -n 60` chooses, fitted, and sent to goals as `verify` sends them, before and after the effect is added. Commands
are in counts; a rest of the tracker errs by 0.2 mm per axis, at goals too. `--levels 5` chooses poses of five angles.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from examples.demo.simulated_tracker import REST_SD_M
from examples.so101.hidden_arm import ARM_FILE, NAMED, hidden_truth
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.design.candidate_poses import ANY, ClearanceRules, clear_poses, floor_above_table, parse_levels
from lrm_ident.design.pose_design import DesignProblem, design
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS, nominal_model
from lrm_ident.measuring.verification.goal_commands import GoalCommand, ModelSolver
from lrm_ident.measuring.verification.goals import PlacedGoal, goals_named
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from validation import synthetic
from validation.options import asked

ARM, COUNT_RAD, POSES, NOISE_M = load_arm("so101"), 2.0 * np.pi / 4096.0, 60, 0.3e-3
Ratio = tuple[str, float, float]
"""Model, error measured at goals, error predicted (m, RMS)."""


def in_counts(q: Array | Sequence[float]) -> Array:
    """Angles (…, n), rad, as servos take them: the next whole count towards zero, so within the limits."""
    return np.trunc(np.asarray(q) / COUNT_RAD) * COUNT_RAD


def designed(levels: str) -> Array:
    """(60, n), rad: the poses that `lrm-ident design so101 -n 60` chooses, in their order."""
    rules = ClearanceRules(floor=floor_above_table(ARM))
    offer = clear_poses(ARM, parse_levels(ARM, levels), (0.0,), rules, 0)
    problem = DesignProblem(nominal_model(ARM, DEFAULT_EFFECTS), None, (), POSES, "O1", NOISE_M, None, 0, 1, 0)
    return in_counts(np.asarray(design(problem, offer.poses).poses.q))


def tips(truth: synthetic.GroundTruth, path: Array) -> Array:
    """(P, 3), true tips (m) after straight moves along joint angles (P, n), rad."""
    schedule = synthetic.Schedule(np.arange(1.0, len(path) + 1.0), np.ones(len(path)), path[0])
    return np.asarray(synthetic.true_state(synthetic.load_arm(ARM_FILE), truth, path, 0.0, schedule).tcp_m)


def ratios(effect: str, seed: int, q: Array, goals: int, folder: Path) -> Iterator[Ratio]:
    """Of the default fit to poses (N, n), rad, and of that with the effect."""
    truth, rng = hidden_truth(synthetic.load_arm(ARM_FILE), effect, seed), np.random.default_rng([seed, 77])
    noise = rng.normal(scale=REST_SD_M, size=(len(q) + goals, 3))
    number = np.arange(1, len(q) + 1)
    tcp = tips(truth, q) + noise[: len(q)]
    data = Measurements.of_tcp(poses_of(q), tcp, REST_SD_M, pose=number, source=Source(Path(effect), "so101", arm=ARM))
    study = Study.of(data).fit()
    wished = goals_named(str(goals), ARM, seed)
    for name, one in (("fit", study), (NAMED[effect][0], study.add(NAMED[effect][0]))):
        one.save(file := folder / f"{effect}-{seed}-{name}.toml")
        solver = ModelSolver.of(file, ARM, lambda q: tuple(in_counts(q).tolist()))
        yield name, *at_goals(truth, solver, q, wished, noise[len(q) :])


def at_goals(
    truth: synthetic.GroundTruth, solver: ModelSolver, q: Array, wished: Sequence[PlacedGoal], noise: Array
) -> tuple[float, float]:
    """RMS errors (m) measured, with `noise` (G, 3), and predicted, of goals after poses (N, n), rad."""
    path, wanted, variance = [q[-1]], list[tuple[float, ...]](), list[float]()
    for goal in wished:
        command = solver.solve(goal.goal, path[-1].tolist(), 0.0)
        if isinstance(command, GoalCommand) and command.sd is not None:
            path.append(np.array(command.q))
            wanted.append(goal.position)
            variance.append(command.rounding**2 + command.sd**2)
    reached = tips(truth, np.array([*q, *path[1:]]))[len(q) :]
    missed = reached + noise[: len(reached)] - np.array(wanted)
    return float(np.sqrt((missed**2).sum(axis=1).mean())), float(np.sqrt(np.mean(variance)))


def main() -> None:
    """Prints a row for each model of each arm, and the median and the range of the ratios."""
    options = asked(__doc__, seeds=8, first=1, goals=40, effects="play,gain", levels=ANY)
    warnings.filterwarnings("ignore")
    q, found = designed(options.levels), dict[str, list[float]]()
    print("| arm | model | measured (mm) | predicted (mm) | ratio |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for effect in options.effects.split(","):
            for seed in range(options.first, options.first + options.seeds):
                for name, measured, predicted in ratios(effect, seed, q, options.goals, Path(folder)):
                    ratio = measured / predicted
                    found.setdefault("fit" if name == "fit" else "with the effect", []).append(ratio)
                    cells = (
                        f"{effect} {seed}",
                        name,
                        f"{1e3 * measured:.2f}",
                        f"{1e3 * predicted:.2f}",
                        f"{ratio:.2f}",
                    )
                    print(f"| {' | '.join(cells)} |", flush=True)
    for name, each in found.items():
        print(f"{name}: median {np.median(each):.2f}, {min(each):.2f} to {max(each):.2f}, {len(each)} arms")


if __name__ == "__main__":
    main()
