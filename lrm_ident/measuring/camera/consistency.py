"""Do the photos belong together? A board of another size, a camera that moved, a board that slipped.

The residual of the poses is regressed on what the arm's errors (with a prior of their typical sizes), the camera's pose
and the board's mount explain; then each suspicion is added: a scale of the board, or a step of the camera or of the
mount between two photos (change point by the largest F statistic, Andrews 1993).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lrm_ident.data.observations.orientations import POSE
from lrm_ident.data.weights.whitening import root_of
from lrm_ident.measuring.camera.hand_eye import HandEye, lever_columns
from lrm_ident.residual.significance import f_test_p_value
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import ParameterRef, effects_at
from lrm_math.kinematics.poses import Poses
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

ARM_ERROR = (5e-4, 2e-3)
"""m and rad: what effects that nobody has named yet leave of a pose."""
JOINT_ERROR = 1e-2
"""rad: what they leave of a joint. One joint moves all six coordinates of a pose: they are no six errors."""
ARM_EFFECTS = ("offsets", "compliance", "servo_gain")
PART = 1e-3
"""m: how far the length of a part is from its drawing; a board of another size is recognised by that."""
FEWEST_SIDE = 6  # photos on either side of a step
SIGNIFICANT = 1e-6
SMALLEST_STEP = 1e-3  # m, or m at a decimetre: a smaller step is not worth a word
SMALLEST_SCALE, SURE = 0.01, 4.0  # of the board's size, and standard errors


@dataclass(frozen=True)
class PhotoStep:
    """A step between the photos `before` and `before` + 1 (from 1): of `what`, by `shift` (m) and `turn` (rad)."""

    what: str
    before: int
    shift: float
    turn: float


@dataclass(frozen=True, eq=False)
class PhotoRegression:
    """Regression of the photos' residual.

    Attributes:
        tool: (N, 4, 4), measured tool poses in the arm's frame. seen: (N, 3), from the camera to the board there (m).
        residual: (N, 6). root: (N, 6, 6), whitening. arm: (N, 6, P), columns of the arm's errors of typical size.
    """

    tool: Array
    seen: Array
    residual: Array
    root: Array
    arm: Array

    @cached_property
    def camera_columns(self) -> Array:
        """(N, 6, 6), a shift and a rotation vector of the camera, in the arm's axes."""
        return lever_columns(self.tool[:, :3, 3])

    @cached_property
    def mount_columns(self) -> Array:
        """(N, 6, 6), a shift and a rotation vector of the board on the tool, in the tool's axes."""
        R = self.tool[:, :3, :3]
        out = np.zeros((len(R), 6, 6))
        out[:, :3, :3] = out[:, 3:, 3:] = R
        return out

    def solved(self, *more: Array) -> tuple[Array, Array, float]:
        """Estimates and covariance of the further columns, and what is left (whitened sum of squares)."""
        extra = sum(part.shape[2] for part in more)
        columns = np.concatenate([self.camera_columns, self.mount_columns, self.arm, *more], axis=2)
        A = np.einsum("nij,njk->nik", self.root, columns).reshape(-1, columns.shape[2])
        r = np.einsum("nij,nj->ni", self.root, self.residual).ravel()
        prior = np.zeros(columns.shape[2])
        prior[12 : 12 + self.arm.shape[2]] = 1.0
        prior[:12] = 1e-6
        stacked = np.concatenate([A, np.diag(np.sqrt(prior))])
        theta, *_ = np.linalg.lstsq(stacked, np.concatenate([r, np.zeros(len(prior))]), rcond=None)
        residual = r - A @ theta
        squares = float(residual @ residual + prior @ theta**2)
        covariance = np.linalg.pinv(stacked.T @ stacked) * max(squares / max(len(r) - 12 - extra, 1), 1.0)
        return theta[-extra:] if extra else theta[:0], covariance[-extra:, -extra:], squares


def photo_regression(arm: Arm, poses: Poses, estimate: HandEye) -> PhotoRegression:
    """The regression of photos taken at commanded poses."""
    model = model_of(arm, [effect for name in ARM_EFFECTS for effect in effects_at(arm, name)])
    keys = [
        key
        for key in model.keys
        if ParameterRef.parse(key).place not in ("base", "tool") or ParameterRef.parse(key).id == "compliance"
    ]
    sizes = [model.parameter(key).typical for key in keys]
    typical = np.array([PART if key.endswith("_mm") else size for key, size in zip(keys, sizes, strict=True)])
    J = parameter_jacobian(solve_equilibrium(model, poses), keys, POSE)
    angles = {str(ParameterRef("offsets", joint, "theta_rad")) for joint in arm.joint_names}
    turns = J[:, :, [key in angles for key in keys]]
    floor = np.diag([ARM_ERROR[0] ** 2] * 3 + [ARM_ERROR[1] ** 2] * 3)
    floor = floor + JOINT_ERROR**2 * turns @ turns.transpose(0, 2, 1)
    from_camera = (estimate.camera[:3, :3] @ estimate.seen[:, :3, 3, None])[:, :, 0]
    return PhotoRegression(
        estimate.tool, from_camera, estimate.residual, root_of(estimate.covariance + floor), J * typical
    )


def board_scale(photos: PhotoRegression) -> tuple[float, float] | None:
    """Factor by which the board is larger than stated, and its standard error; None if it is as stated."""
    larger = np.pad(photos.seen, ((0, 0), (0, 3)))[:, :, None]  # by its whole size
    (scale,), covariance, _ = photos.solved(larger)
    error = float(np.sqrt(covariance[0, 0]))
    # The residual is measured less nominal: measured positions too large by s shrink under a larger board by −s.
    if abs(scale) < max(SMALLEST_SCALE, SURE * error):
        return None
    return 1.0 / (1.0 + float(scale)), error


def find_step(photos: PhotoRegression) -> PhotoStep | None:
    """A step of the camera or of the board's mount between two photos, if there surely is one."""
    count = len(photos.tool)
    _, _, before = photos.solved()
    moved = {"camera": photos.camera_columns, "board": photos.mount_columns}
    number, tried = np.arange(count)[:, None, None], []
    for what, columns in moved.items():
        for k in range(FEWEST_SIDE, count - FEWEST_SIDE + 1):
            theta, _, squares = photos.solved(columns * (number >= k))
            tried.append((squares, what, k, theta))
    if not tried:
        return None
    squares, what, k, theta = min(tried, key=lambda trial: trial[0])
    p_value = f_test_p_value(before, squares, 6, 6 * count - 12) * len(tried)
    shift, turn = float(np.linalg.norm(theta[:3])), float(np.linalg.norm(theta[3:]))
    size = float(np.sqrt(((moved[what] @ theta)[k:, :3] ** 2).sum(axis=1).mean())) + 0.1 * turn
    if p_value > SIGNIFICANT or size < SMALLEST_STEP:
        return None
    return PhotoStep(what, k, shift, turn)
