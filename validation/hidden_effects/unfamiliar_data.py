"""Data sets of the second catalogue: any arm, loads, levels and outliers; and poses without noise to check a model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_math.arrays import Array
from validation.hidden_effects.case_generator import stable_seed
from validation.hidden_effects.data import ARM_FILE, BREAK_S, FLOOR_M, NOISE_M
from validation.hidden_effects.unfamiliar_effects import LAB, UnfamiliarCase
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
    true_state,
    write,
)

ARMS = Path(__file__).resolve().parent / "arms"
FIRST_SEED = {"tune": 0, "report": 1000, "unforeseen": 2000, "second-unforeseen": 3000}
OUTLIER_M = (0.005, 0.025)


def arm_file(case: UnfamiliarCase) -> Path:
    """The description of the case's arm."""
    return ARM_FILE if case.arm == LAB else ARMS / f"{case.arm}.toml"


def measured(case: UnfamiliarCase, seed: int, count: int) -> Dataset:
    """The data set that the tool sees: random order, loads at random, noise, and the case's outliers."""
    number = FIRST_SEED[case.half] + seed
    data = _simulated(case, number, count, "poses", NOISE_M)
    rng = np.random.default_rng(stable_seed(case.name, number, "outliers"))
    rows = rng.permutation(count)[: round(case.outliers * count)]
    out = rng.normal(size=(len(rows), 3))
    out *= (rng.uniform(*OUTLIER_M, len(rows)) / np.linalg.norm(out, axis=1))[:, None]
    tcp = data.tcp_m.copy()
    tcp[rows] += out
    return replace(data, tcp_m=tcp)


def unseen(case: UnfamiliarCase, seed: int, count: int) -> Dataset:
    """Other poses of the same arm, as many, at the same times, without noise."""
    return _simulated(case, FIRST_SEED[case.half] + seed, count, "unseen", 0.0)


def write_data(case: UnfamiliarCase, seed: int, count: int, folder: Path) -> tuple[Path, Path]:
    """Writes both data sets into a folder; returns the paths of their tables."""
    source = f"synthetic: validation.hidden_effects, case {case.name}, seed {seed}; the truth file says what is hidden"
    both = {"measured": measured(case, seed, count), "unseen": unseen(case, seed, count)}
    paths = [write(folder / name, data, source)[0] for name, data in both.items()]
    paths[1].with_suffix(".toml").unlink()  # says that there is no noise, which no measurement may say
    return paths[0], paths[1]


def _simulated(case: UnfamiliarCase, seed: int, count: int, what: str, noise_m: float) -> Dataset:
    arm = load_arm(arm_file(case))
    truth = base_displacement_to_deviations(
        arm, GroundTruth.random(arm, stable_seed(case.name, seed, "arm"), case.build(arm, seed))
    )
    q = _poses(case, arm, stable_seed(case.name, seed, what), count)
    load = np.random.default_rng(stable_seed(case.name, seed, what, "loads")).choice(case.loads_kg, size=count)
    return simulate(arm, truth, q, load, noise_m, stable_seed(case.name, seed, "noise"), _schedule(case, *q.shape))


def _poses(case: UnfamiliarCase, arm: ArmDescription, seed: int, count: int) -> Array:
    """(count, N) rad, at any angle or at the case's levels, the nominal TCP above the floor."""
    if not case.levels_deg:
        return random_poses(arm, count, seed, floor_m=FLOOR_M)
    many = np.random.default_rng(seed).choice(np.radians(case.levels_deg), size=(20 * count, len(arm.links)))
    return many[true_state(arm, GroundTruth.nominal(arm), many).tcp_m[:, 2] > FLOOR_M][:count]


def _schedule(case: UnfamiliarCase, count: int, joints: int) -> Schedule:
    """A pose every 15 s, in sessions of equal length with a break between them."""
    plain = even_schedule(count, joints)
    before = np.floor(np.arange(count) * case.sessions / count)
    return Schedule(plain.time_s + BREAK_S * before, plain.session + before, plain.start_q_rad)
