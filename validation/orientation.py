"""`python -m validation.orientation`: what measured orientations add to positions, on simulated lab arms.

Arms with random errors and compliances (`validation.synthetic`) are measured at the same poses twice: positions alone,
and positions with the tool's orientation. Both are fitted; printed is how far the tip and its angle are off at fresh
poses, RMS.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.rigid_motion import quaternions, rotation_vectors
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.sensed import tool_rotation
from validation import synthetic
from validation.hidden_effects.data import ARM_FILE, FLOOR_M, LOADS_KG, NOISE_M
from validation.synthetic.screws import rotation_matrix

FRESH = 200
TURN_NOISE_DEG = 0.1
"""About every axis: a target of 100 mm with markers seen to 0.15 mm."""
COLUMNS = ("qw", "qx", "qy", "qz", "srot_deg")


def main() -> None:
    """Prints the errors of some arms, for some numbers of poses."""
    parser = argparse.ArgumentParser("python -m validation.orientation", description=__doc__)
    parser.add_argument("--seeds", type=int, default=6, help="number of arms")
    parser.add_argument("--poses", type=int, nargs="*", default=[30, 100])
    options = parser.parse_args()
    print("poses | model | tip mm RMS: mean, max | angle deg RMS: mean, max")
    for poses in options.poses:
        found = np.array([of_arm(seed, poses) for seed in range(options.seeds)])
        for row, name in enumerate(("nominal", "positions", "positions and orientations")):
            cells = [f"{of.mean():.3f}, {of.max():.3f}" for of in found[:, row].T]
            print(poses, name, *cells, sep=" | ", flush=True)


def of_arm(seed: int, poses: int) -> Array:
    """(3, 2), tip (mm) and angle (deg) RMS of one arm: as drawn, fitted to positions, and to poses."""
    rng, arm = np.random.default_rng(seed), synthetic.load_arm(ARM_FILE)
    truth = synthetic.base_displacement_to_deviations(arm, synthetic.GroundTruth.random(arm, seed))
    q, load = synthetic.random_poses(arm, poses, seed, floor_m=FLOOR_M), rng.choice(LOADS_KG, size=poses)
    with tempfile.TemporaryDirectory() as folder:
        data = synthetic.simulate(arm, truth, q, load, NOISE_M, seed)
        path, *_ = synthetic.write(Path(folder) / "positions", data, "synthetic: validation.orientation")
        turned = synthetic.true_state(arm, truth, q, load).posture.tool_axes
        noise = rotation_matrix(rng.normal(scale=np.radians(TURN_NOISE_DEG), size=(poses, 3)))
        whole = with_orientations(path, noise @ turned)
        nominal = load_arm(str(ARM_FILE))
        models = [Study.of(load_measurements(one, nominal)).fit().model for one in (path, whole)]
    fresh = synthetic.random_poses(arm, FRESH, seed + 1000, floor_m=FLOOR_M)
    fresh_load = rng.choice(LOADS_KG, size=FRESH)
    state = synthetic.true_state(arm, truth, fresh, fresh_load)
    out = []
    for model in (model_of(nominal, ()), *models):
        settled = solve_equilibrium(model, poses_of(fresh, fresh_load))
        tip = np.linalg.norm(settled.tcp - state.tcp_m, axis=1)
        off = rotation_vectors(state.posture.tool_axes @ tool_rotation(settled).transpose(0, 2, 1))
        angle = np.degrees(np.linalg.norm(off, axis=1))
        out.append([1e3 * np.sqrt(np.mean(tip**2)), np.sqrt(np.mean(angle**2))])
    return np.array(out)


def with_orientations(path: Path, turned: Array) -> Path:
    """A copy of measurements, with orientations (N, 3, 3) and their standard deviation."""
    with path.open(encoding="utf-8") as file:
        head, *rows = list(csv.reader(file))
    stated = [[f"{value:.7f}" for value in q] + [str(TURN_NOISE_DEG)] for q in quaternions(turned).tolist()]
    whole = path.with_name("whole.csv")
    lines = [[*head, *COLUMNS], *([*row, *more] for row, more in zip(rows, stated, strict=True))]
    whole.write_text("\n".join(",".join(line) for line in lines) + "\n", encoding="utf-8")
    whole.with_suffix(".toml").write_text(path.with_suffix(".toml").read_text(encoding="utf-8"), encoding="utf-8")
    return whole


if __name__ == "__main__":
    main()
