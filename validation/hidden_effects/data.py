"""One data set of a case, as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lrm_math.arrays import Array
from validation.hidden_effects.case_generator import HiddenEffectCase, stable_seed
from validation.synthetic import (
    ArmDescription,
    Dataset,
    GroundTruth,
    Schedule,
    base_displacement_to_deviations,
    even_schedule,
    load_arm,
    random_poses,
    simulate,
    write,
)

ARM_FILE = Path(__file__).resolve().parents[2] / "config" / "arms" / "lrm-lab.toml"
LOADS_KG = (0.0, 0.0663)
NOISE_M = 0.0003  # per axis
FLOOR_M = 0.1  # of the rigid nominal arm; leaves room for sagging
BREAK_S = 3600.0  # between two sessions


def true_arm(case: HiddenEffectCase, seed: int, arm: ArmDescription) -> GroundTruth:
    """Random errors and compliances, and the effects of the case; the base bends about the published model's axis."""
    return base_displacement_to_deviations(
        arm, GroundTruth.random(arm, stable_seed(case.name, seed, "arm"), case.build(arm, seed))
    )


def schedule(case: HiddenEffectCase, count: int, joints: int) -> Schedule:
    """A pose every 15 s, in sessions of equal length with a break between them."""
    plain = even_schedule(count, joints)
    before = np.floor(np.arange(count) * case.sessions / count)
    return Schedule(plain.time_s + BREAK_S * before, plain.session + before, plain.start_q_rad)


def measured_poses(case: HiddenEffectCase, seed: int, count: int, arm: ArmDescription) -> tuple[Array, Array, Schedule]:
    """Random joint angles (P, N) in rad in random order, the load (P,) in kg of each at random, and when each is."""
    q = random_poses(arm, count, stable_seed(case.name, seed, "poses"), floor_m=FLOOR_M)
    load = np.random.default_rng(stable_seed(case.name, seed, "loads")).choice(LOADS_KG, size=count)
    return q, load, schedule(case, *q.shape)


def dataset(case: HiddenEffectCase, seed: int, count: int) -> Dataset:
    """The true arm at those poses, measured with noise."""
    arm = load_arm(ARM_FILE)
    q, load, plan = measured_poses(case, seed, count, arm)
    return simulate(arm, true_arm(case, seed, arm), q, load, NOISE_M, stable_seed(case.name, seed, "noise"), plan)


def write_case(case: HiddenEffectCase, seed: int, count: int, folder: Path) -> Path:
    """Write DATA.csv, its description and its truth into a folder; return the path of the CSV."""
    source = f"synthetic: validation.hidden_effects, case {case.name}, seed {seed}; the truth file says what is hidden"
    path, _, _ = write(folder / f"{case.name}-{seed}-{count}", dataset(case, seed, count), source)
    return path
