"""Photos as poses with noise: positions with one standard deviation, with their covariance, and whole poses.

An SO-101 before one camera, a board of twelve corners, 0.3 px. `python -m validation.camera.pose_coverage` prints for
each way how well the tip is known at other poses, and how often the 95 % intervals of the parameters hold the truth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.weights.whitening import position_sd
from lrm_ident.fitting.identifiability import select_identifiable
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.parameter_sets import no_bounds
from lrm_ident.measuring.camera.board import CharucoBoard
from lrm_ident.measuring.camera.board_pose import covariance_at
from lrm_ident.measuring.camera.hand_eye import measured_covariance
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.sensed import tool_rotation
from validation.camera.rendered_photos import WEBCAM
from validation.camera.scene import CameraRig, poses_in_view, rig
from validation.options import asked

TWELVE = CharucoBoard(columns=5, rows=4, square_mm=20.0)
LARGER = {name: 1.5 * getattr(WEBCAM, name) for name in ("focal_x_px", "focal_y_px", "centre_x_px", "centre_y_px")}
HD = {"width_px": 1920, "height_px": 1080, "noise_px": 0.3, "board": TWELVE}
LENS = WEBCAM.model_copy(update=LARGER | HD)
"""At 1080p."""
SHARE = 0.2  # of typical sizes: the errors of the arms
WAYS = ("positions, one sd", "positions, covariance", "poses, covariance")
TWO_SIDED_95 = 1.959964


@dataclass(frozen=True, eq=False)
class EstimatorErrors:
    """One way to use the photos: (estimate − truth) / standard error (S, P), RMS error of the tip (S,) in m."""

    z: Array
    tip: Array

    @property
    def within_95(self) -> float:
        """Share of the 95 % intervals that hold the truth."""
        return float(np.mean(np.abs(self.z) < TWO_SIDED_95))


def photographed(true: CameraRig, model: Model, poses: Poses, rng: np.random.Generator) -> Measurements:
    """Tool poses as photos of the board give them, with noise of their covariance."""
    equilibrium = solve_equilibrium(model, poses)
    boards = true.boards(equilibrium)
    own = np.array([covariance_at(board, LENS) for board in boards])
    covariance = measured_covariance(true.camera, true.mount, boards, own)
    error = np.array([rng.multivariate_normal(np.zeros(6), one) for one in covariance])
    number = np.arange(1, len(poses) + 1)
    sd = position_sd(covariance)
    attitude = Rotation.from_rotvec(error[:, 3:]).as_matrix() @ tool_rotation(equilibrium)
    return Measurements(
        poses, number, equilibrium.tcp + error[:, :3], sd, None, number, Path("photos"), "", covariance=covariance,
        attitude=attitude,
    )  # fmt: skip


def ways_of(data: Measurements) -> Iterator[Measurements]:
    """The data, used in each of `WAYS`."""
    one_sd = np.full(len(data), np.sqrt(np.mean(data.sd**2)))  # type: ignore[operator]
    yield replace(data, covariance=None, attitude=None, sd=one_sd)
    yield replace(data, attitude=None)
    yield data


def compare(count: int, seeds: int) -> list[EstimatorErrors]:
    """Every way with `count` poses, over `seeds` arms."""
    true = rig(0, {})
    arm = true.model.arm
    empty = model_of(arm, [effect for name in ("offsets", "compliance") for effect in effects_at(arm, name)])
    fresh = poses_in_view(true, 100, 999)
    found: list[list[tuple[Array, float]]] = [[] for _ in WAYS]
    for seed in range(seeds):
        rng = np.random.default_rng([seed, count])
        poses = poses_in_view(true, count, 1000 * count + seed)
        first = photographed(true, empty, poses, rng)
        equilibrium = solve_equilibrium(empty, poses)
        keys = select_identifiable(equilibrium, empty.keys, 1e-3, replace(first, attitude=None).whitening).kept[
            : count - 1
        ]
        typical = np.array([empty.parameter(key).typical for key in keys])
        values = dict(zip(keys, (SHARE * rng.normal(size=len(keys)) * typical).tolist(), strict=True))
        values |= {key: abs(value) for key, value in values.items() if key.startswith("compliance")}
        truth = model_of(arm, empty.effects, values)
        start, exact = replace(empty, free=keys), np.array([values[key] for key in keys])
        there = solve_equilibrium(truth, fresh).tcp
        for results, data in zip(found, ways_of(photographed(true, truth, poses, rng)), strict=True):
            fitted = fit(start, data, no_bounds(keys))
            estimate = np.array([fitted.model.value(key) for key in keys])
            off = solve_equilibrium(fitted.model, fresh).tcp - there
            results.append(((estimate - exact) / fitted.standard_error, float(np.sqrt((off**2).sum(axis=1).mean()))))
    return [EstimatorErrors(np.concatenate([z for z, _ in each]), np.array([tip for _, tip in each])) for each in found]


def main() -> None:
    """Prints the table."""
    seeds = asked(__doc__, seeds=30).seeds
    print(f"{seeds} arms each; RMS error of the tip (mm), and share of the 95 % intervals that hold the truth")
    for count in (25, 60, 150):
        for name, way in zip(WAYS, compare(count, seeds), strict=True):
            tip = 1e3 * float(np.sqrt(np.mean(way.tip**2)))
            print(f"{count:4d} poses, {name:24s} {tip:6.2f} mm  {100 * way.within_95:5.1f} %", flush=True)


if __name__ == "__main__":
    main()
