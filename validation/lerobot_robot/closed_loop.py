"""Goals approached from both sides: tip error without the plug-in, with it, and of perfect commands (the floor)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from examples.so101.hidden_arm import ARM_FILE, JOINTS, hidden_truth
from examples.so101.launch import simulated_so101
from lrm_ident.data.error_stats import error_stats
from lrm_math.arrays import Array
from validation.lerobot_robot.fitted_model import fit_hidden
from validation.lerobot_robot.simulated_follower import angles_of, follower, rest_at, with_retries
from validation.synthetic import ArmDescription, GroundTruth, Schedule, load_arm, random_poses, true_state

GOALS, LIMIT_DEG = 8, 50.0
BESIDE = np.radians(12.0)
"""Every joint comes from so far below, and then from so far above."""
NUDGE, STEPS = 1e-5, 12


@dataclass(frozen=True)
class TipErrors:
    """RMS of the distance of the tip from where the arm as drawn would have it (m). `observed`: RMS of what the
    calibrated robot observes less what was wished, of a joint (rad)."""

    without: float
    calibrated: float
    floor: float
    observed: float


def closed_loop(effect: str, seed: int, folder: Path) -> TipErrors:
    """All three over the same goals."""
    arm = load_arm(ARM_FILE)
    truth = hidden_truth(arm, effect, seed)
    model = fit_hidden(truth, effect, seed, folder)
    path = both_sides(random_poses(arm, GOALS, seed + 1000, LIMIT_DEG))
    drawn = true_state(arm, GroundTruth.nominal(arm), path).tcp_m
    with simulated_so101(folder, effect, seed) as link:
        with follower(link, "so101_follower") as robot:
            without = [rest_at(robot, link, q)[1] for q in path]
            perfect = perfect_commands(arm, truth, path, drawn)
            floor = [rest_at(robot, link, q)[1] for q in perfect]
        with follower(link, "so101_follower_calibrated", model=str(model)) as robot:
            rests, seen = [], []
            for q in path:
                rests.append(rest_at(robot, link, q)[1])
                seen.append(angles_of(with_retries(robot, robot.get_observation)) - q)
    goals = slice(1, None, 2)
    off, calibrated, least = (error_stats((np.array(tips) - drawn)[goals]).rms for tips in (without, rests, floor))
    return TipErrors(off, calibrated, least, float(np.sqrt(np.mean(np.square(seen)[goals]))))


def both_sides(goals: Array) -> Array:
    """(4 K, n): beside each goal (K, n), the goal, beside it on the other side, the goal again."""
    return np.concatenate([[q - BESIDE, q, q + BESIDE, q] for q in goals])


def perfect_commands(arm: ArmDescription, truth: GroundTruth, path: Array, tips: Array) -> Array:
    """(P, n), commands whose true tips, one after the other, are `tips` (P, 3), m: Newton's method on the truth."""
    nominal = GroundTruth.nominal(arm)
    nudged = [true_state(arm, nominal, path + e).tcp_m - tips for e in NUDGE * np.eye(JOINTS)]
    back = np.linalg.pinv(np.stack(nudged, axis=2) / NUDGE)
    schedule = Schedule(np.arange(1.0, len(path) + 1.0), np.ones(len(path)), np.zeros(JOINTS))
    q = path.copy()
    for _ in range(STEPS):
        q = q + np.einsum("pij,pj->pi", back, tips - true_state(arm, truth, q, 0.0, schedule).tcp_m)
    return q
