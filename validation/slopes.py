"""`python -m validation.slopes`: tip errors of an arm that was calibrated on a level floor and drives onto a slope.

Simulated lab arms with random errors and compliances (`validation.synthetic`), fitted to 300 poses. Then the vehicle
stands on a slope in a random direction: errors at 200 fresh poses, mm RMS, of the deployed model as it is, and with the
direction of gravity that `cmd/gravity` tells, exactly and by an accelerometer that is off by 0.5 deg.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array, Vector3
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import as_deployed, under_gravity
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from validation import synthetic
from validation.hidden_effects.data import ARM_FILE, FLOOR_M, LOADS_KG, NOISE_M
from validation.options import asked
from validation.synthetic.screws import rotation_matrix

POSES, FRESH = 300, 200
SLOPES_DEG = (0, 5, 10, 20)
IMU_DEG = 0.5


def main() -> None:
    """Prints the mean and the largest RMS of some arms on each slope."""
    seeds = range(asked(__doc__, seeds=(8, "number of arms")).seeds)
    errors = np.array([of_arm(seed) for seed in seeds])
    print("slope deg | level model: mean, max mm | cmd/gravity | with an accelerometer off by 0.5 deg")
    for row, slope in enumerate(SLOPES_DEG):
        print(slope, *(f"{of.mean():.2f}, {of.max():.2f}" for of in errors[:, row].T), sep=" | ")


def of_arm(seed: int) -> Array:
    """(slopes, 3), RMS errors (mm) of one arm: with the model as it is, and with gravity told in two ways."""
    rng, arm = np.random.default_rng(seed), synthetic.load_arm(ARM_FILE)
    truth = synthetic.base_displacement_to_deviations(arm, synthetic.GroundTruth.random(arm, seed))
    model = calibrated(arm, truth, rng, seed)
    q = synthetic.random_poses(arm, FRESH, seed + 1000, floor_m=FLOOR_M)
    load = rng.choice(LOADS_KG, size=FRESH)
    out = []
    for slope in SLOPES_DEG:
        around = rng.uniform(0.0, 2.0 * math.pi)
        down = leaning(arm.gravity_m_per_s2, around, slope)
        told = leaning(down, rng.uniform(0.0, 2.0 * math.pi), IMU_DEG)
        tips = synthetic.true_state(replace(arm, gravity_m_per_s2=down), truth, q, load).tcp_m
        models = (model, *(under_gravity(model, unit(direction)) for direction in (down, told)))
        found = [solve_equilibrium(one, poses_of(q, load)).tcp - tips for one in models]
        out.append([1e3 * error_stats(error).rms for error in found])
    return np.array(out)


def calibrated(
    arm: synthetic.ArmDescription, truth: synthetic.GroundTruth, rng: np.random.Generator, seed: int
) -> Model:
    """The deployed model of an arm, fitted to measurements on a level floor."""
    q = synthetic.random_poses(arm, POSES, seed, floor_m=FLOOR_M)
    data = synthetic.simulate(arm, truth, q, rng.choice(LOADS_KG, size=POSES), NOISE_M, seed)
    with tempfile.TemporaryDirectory() as folder:
        path, *_ = synthetic.write(Path(folder) / "level", data, "synthetic: validation.slopes")
        return as_deployed(Study.of(load_measurements(path, load_arm(str(ARM_FILE)))).fit().model)


def leaning(gravity: Vector3, around: float, degrees: float) -> Vector3:
    """Gravity turned about a level axis in the direction `around` (rad)."""
    turn = math.radians(degrees) * np.array([math.cos(around), math.sin(around), 0.0])
    x, y, z = (rotation_matrix(turn) @ np.array(gravity)).tolist()
    return x, y, z


def unit(vector: Vector3) -> Vector3:
    """The direction of a vector."""
    x, y, z = (component / math.hypot(*vector) for component in vector)
    return x, y, z


if __name__ == "__main__":
    main()
