"""The data sets of a case: what the tool sees, and other poses to check a model; in memory and as files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from validation.hidden_effects.case import ARM_FILE, FIRST_SEED, NAMED, TWO_LOADS, Case, stable_seed
from validation.hidden_effects.faults.measurement import NOISE_M, HealthyMeasurement
from validation.synthetic import (
    ArmDescription,
    Dataset,
    GroundTruth,
    Schedule,
    base_displacement_to_deviations,
    even_schedule,
    load_arm,
    measure,
    random_poses,
    simulate,
    true_state,
    write,
)
from validation.synthetic.generate import directions

LOADS_KG = TWO_LOADS
FLOOR_M = 0.1  # of the rigid nominal arm; leaves room for sagging
BREAK_S = 3600.0  # between two sessions
OUTLIER_M = (0.005, 0.025)
MEASURED, UNSEEN = "poses", "unseen"

__all__ = ["ARM_FILE", "BREAK_S", "FLOOR_M", "LOADS_KG", "NOISE_M", "OUTLIER_M"]


def true_arm(case: Case, seed: int, arm: ArmDescription) -> GroundTruth:
    """Random errors and compliances, and the effects of the case; the base bends about the published model's axis."""
    return base_displacement_to_deviations(
        arm, GroundTruth.random(arm, stable_seed(case.name, seed, "arm"), case.build(arm, seed))
    )


def measured_poses(
    case: Case, seed: int, count: int, arm: ArmDescription, what: str = MEASURED
) -> tuple[Array, Array, Schedule]:
    """Random joint angles (P, N) in rad in random order, the load (P,) in kg of each at random, and when each is."""
    if case.waits is not None:
        return _poses_with_waits(case, seed, count, arm, what)
    q = drawn_poses(case, arm, stable_seed(case.name, seed, what), count)
    words = ("loads",) if case.part == NAMED else (what, "loads")
    load = np.random.default_rng(stable_seed(case.name, seed, *words)).choice(case.loads_kg, size=count)
    plain = even_schedule(*q.shape)
    before = np.floor(np.arange(count) * case.sessions / count)
    return q, load, Schedule(plain.time_s + BREAK_S * before, plain.session + before, plain.start_q_rad)


def drawn_poses(case: Case, arm: ArmDescription, seed: int, count: int) -> Array:
    """(count, N) rad, at any angle or at the case's levels, the nominal TCP above the floor."""
    if not case.levels_deg:
        return random_poses(arm, count, seed, floor_m=FLOOR_M)
    many = np.random.default_rng(seed).choice(np.radians(case.levels_deg), size=(20 * count, len(arm.links)))
    return many[true_state(arm, GroundTruth.nominal(arm), many).tcp_m[:, 2] > FLOOR_M][:count]


def _poses_with_waits(
    case: Case, seed: int, count: int, arm: ArmDescription, what: str
) -> tuple[Array, Array, Schedule]:
    """The same where readings wait for each other; one draw after another: waits, loads, those of the unseen poses."""
    assert case.waits is not None
    rng = np.random.default_rng(stable_seed(case.name, seed, "order"))
    plan = Schedule(np.cumsum(case.waits(rng, count)), np.ones(count), np.zeros(len(arm.links)))
    loads = {name: rng.choice(case.loads_kg, count) for name in (MEASURED, UNSEEN)}
    return random_poses(arm, count, stable_seed(case.name, seed, what)), loads[what], plan


def _simulated(case: Case, seed: int, count: int, what: str, noise_m: float) -> Dataset:
    arm, number = load_arm(case.arm_file), FIRST_SEED[case.part] + seed
    q, load, plan = measured_poses(case, number, count, arm, what)
    return simulate(arm, true_arm(case, number, arm), q, load, noise_m, stable_seed(case.name, number, "noise"), plan)


def dataset(case: Case, seed: int, count: int) -> Dataset:
    """The data set that the tool sees: the true arm at random poses, with noise and the case's outliers."""
    data = _simulated(case, seed, count, MEASURED, NOISE_M)
    rng = np.random.default_rng(stable_seed(case.name, FIRST_SEED[case.part] + seed, "outliers"))
    return replace(data, tcp_m=with_outliers_of(data.tcp_m, round(case.outliers * count), rng))


def with_outliers_of(tcp_m: Array, number: int, rng: np.random.Generator) -> Array:
    """(P, 3), positions of which some are out by 5 to 25 mm."""
    rows = rng.permutation(len(tcp_m))[:number]
    out = rng.normal(size=(len(rows), 3))
    out *= (rng.uniform(*OUTLIER_M, len(rows)) / np.linalg.norm(out, axis=1))[:, None]
    tcp = tcp_m.copy()
    tcp[rows] += out
    return tcp


def unseen(case: Case, seed: int, count: int) -> Dataset:
    """Other poses of the same arm, as many, at the same times, without noise."""
    return _simulated(case, seed, count, UNSEEN, 0.0)


def write_case(case: Case, seed: int, count: int, folder: Path, name: str = "") -> Path:
    """Writes DATA.csv, its description and its truth into a folder; returns the path of the CSV."""
    return write(folder / (name or f"{case.name}-{seed}-{count}"), dataset(case, seed, count), _source(case, seed))[0]


def write_data(case: Case, seed: int, count: int, folder: Path) -> tuple[Path, Path]:
    """Writes both data sets into a folder; returns the paths of their tables."""
    path = write(folder / UNSEEN, unseen(case, seed, count), _source(case, seed))[0]
    path.with_suffix(".toml").unlink()  # says that there is no noise, which no measurement may say
    return write_case(case, seed, count, folder, "measured"), path


def _source(case: Case, seed: int) -> str:
    return f"synthetic: validation.hidden_effects, case {case.name}, seed {seed}; the truth file says what is hidden"


def spoiled(case: Case, seed: int, count: int) -> tuple[Measurements, tuple[str, ...]]:
    """The measurement of a case with a fault, and the names that are right for it."""
    assert case.spoil is not None
    arm, number = load_arm(case.arm_file), FIRST_SEED[case.part] + seed
    truth = base_displacement_to_deviations(arm, GroundTruth.random(arm, number, ()))
    rng = np.random.default_rng(stable_seed(case.name, number, "fault"))
    q = random_poses(arm, count, number, floor_m=FLOOR_M)
    plan, load = even_schedule(*q.shape), rng.choice(LOADS_KG, count)

    def at(angles: Array) -> Array:
        return measure(arm, truth, angles, load, NOISE_M, number, plan)

    found = case.spoil(HealthyMeasurement(q, load, at(q), at, rng))
    written, carried = q if found.q is None else found.q, load if found.load is None else found.load
    noise, pose = NOISE_M if case.noise_known else None, np.arange(1, count + 1)
    came = directions(written, np.zeros(q.shape[1]))
    poses = Poses(written, carried, came, plan.time_s, found.session, number=pose)
    return Measurements.of_tcp(poses, found.tcp, noise, pose=pose), found.right
