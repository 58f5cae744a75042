"""An SO-101 with a hidden effect before a webcam: poses that show the board, and what the photos would show."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.conventions import frame_motion
from lrm_ident.data.registration.similarity import similarity
from lrm_ident.data.rigid_motion import inverse
from lrm_ident.measuring.camera.board import CharucoBoard
from lrm_ident.measuring.camera.opencv import opencv
from lrm_ident.measuring.camera.session import CameraSession
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import ParameterRef, effect_of, effects_at
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.sensed import tool_rotation
from validation.camera.rendered_photos import PhotoScene

BOARD = CharucoBoard()
HIDDEN = {"servo_gain.joint3.g_plus_rad_per_rad": 0.02, "servo_gain.joint3.g_minus_rad_per_rad": 0.02}
"""The servo of the elbow turns two percent too far."""


def pose(xyz: tuple[float, float, float], z: tuple[float, float, float], up: tuple[float, float, float]) -> Array:
    """(4, 4), a frame with this z axis whose y axis points away from `up`."""
    axis = np.array(z) / np.linalg.norm(z)
    x = np.cross(axis, np.array(up))
    x /= np.linalg.norm(x)
    out = np.eye(4)
    out[:3, :3] = np.stack([x, np.cross(axis, x), axis], axis=1)
    out[:3, 3] = xyz
    return out


CAMERA = pose((0.62, 0.06, 0.22), (-1.0, -0.12, -0.08), (0.0, 0.0, 1.0))
"""In front of the arm, a little to its left, looking back at it."""


@dataclass(frozen=True, eq=False)
class CameraRig:
    """The true arm, the camera in its frame and the board on its tool (4, 4)."""

    model: Model
    camera: Array
    mount: Array

    def boards(self, equilibrium: Equilibrium) -> Array:
        """(N, 4, 4), the board in the camera's frame."""
        tool = np.tile(np.eye(4), (len(equilibrium.poses), 1, 1))
        tool[:, :3, :3], tool[:, :3, 3] = tool_rotation(equilibrium), equilibrium.tcp
        return inverse(self.camera) @ tool @ self.mount

    def shows(self, q: Array) -> NDArray[np.bool_]:
        """(N,), whether the camera sees the whole board, near and not too much from the side, at angles (N, n), rad."""
        seen = self.boards(solve_equilibrium(self.model, poses_of(q)))
        corners = BOARD.corners @ seen[:, :3, :3].transpose(0, 2, 1) + seen[:, None, :3, 3]
        ahead = (corners[:, :, 2] > 0.12).all(axis=1) & (seen[:, 2, 3] < 0.6)
        facing = np.einsum("ni,ni->n", seen[:, :3, 2], seen[:, :3, 3]) > 0.5 * np.linalg.norm(seen[:, :3, 3], axis=1)
        lens = PhotoScene().lens
        pixels = lens.project(np.where(ahead[:, None, None], corners, [0, 0, 1.0]).reshape(-1, 3))[0]
        inside = ((pixels > 20) & (pixels < np.subtract(lens.size, 20))).all(axis=1).reshape(len(q), -1).all(axis=1)
        above = solve_equilibrium(self.model, poses_of(q)).tcp[:, 2] > 0.02
        shown: NDArray[np.bool_] = ahead & facing & inside & above
        return shown


def rig(seed: int, hidden: dict[str, float]) -> CameraRig:
    """An SO-101 with errors of assembly, soft joints, and a hidden effect (keys of parameters, SI)."""
    arm = load_arm("so101")
    rng = np.random.default_rng(seed)
    names = ["offsets", "compliance", *dict.fromkeys(effect_of(key) for key in hidden)]
    model = model_of(arm, [effect for name in names for effect in effects_at(arm, name)])
    values = dict(hidden)
    for key in model.keys:
        effect, place, name = ParameterRef.parse(key)
        if effect == "offsets" and place.startswith("joint"):
            values[key] = float(rng.normal(0, 0.012 if name.endswith("rad") else 0.7e-3))
        if effect == "compliance" and place.startswith("joint"):
            values[key] = float(rng.uniform(0.02, 0.06))
    return CameraRig(model_of(arm, model.effects, values), CAMERA, board_mount(arm))


def board_mount(arm: Arm) -> Array:
    """(4, 4), the board on the gripper: it faces forward, away from the arm, when the arm reaches out."""
    mount = np.eye(4)
    mount[:3, :3] = Rotation.from_euler("xyz", [0.05, -0.03, 0.02]).as_matrix() @ _facing(arm)
    mount[:3, 3] = mount[:3, :3] @ np.array([-0.045, -0.0375, 0.0]) + np.array([0.0, 0.0, 0.03])
    return mount


def _facing(arm: Arm) -> Array:
    """(3, 3), rotation in the tool's frame after which the board's z points back along the reaching arm."""
    equilibrium = solve_equilibrium(model_of(arm, ()), poses_of(np.zeros(arm.dof)))
    R = tool_rotation(equilibrium)[0]
    board = np.stack([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]], axis=1)
    return np.asarray(R.T @ board)


def poses_in_view(true: CameraRig, count: int, seed: int) -> Poses:
    """Poses at which the camera sees the whole board, spread over the joints."""
    arm, rng = true.model.arm, np.random.default_rng([seed, 3])
    low, high = 0.85 * np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    found: list[Array] = []
    while len(found) < count:
        q = rng.uniform(low, high, (200, arm.dof))
        found += list(q[true.shows(q)])
    return poses_of(np.array(found[:count]))


def write_lens_photos(folder: Path, scene: PhotoScene, count: int) -> None:
    """Photos of the board held by hand: near and far, leaning, all over the picture."""
    cv2, rng = opencv(), np.random.default_rng(5)
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        held = np.eye(4)
        held[:3, :3] = Rotation.from_rotvec(rng.uniform(-0.7, 0.7, 3)).as_matrix()
        held[:3, 3] = rng.uniform([-0.16, -0.1, 0.2], [0.12, 0.06, 0.42])
        cv2.imwrite(str(folder / f"lens{number}.png"), scene.photo(BOARD, held, 500 + number))


def write_arm_photos(folder: Path, scene: PhotoScene, boards: Array) -> None:
    """Photos of the board at poses (N, 4, 4) in the camera's frame."""
    cv2 = opencv()
    folder.mkdir(parents=True, exist_ok=True)
    for number, pose_of_board in enumerate(boards):
        cv2.imwrite(str(folder / f"pose{number + 1}.png"), scene.photo(BOARD, pose_of_board, number))


def write_poses(path: Path, poses: Poses) -> None:
    """The commanded poses as a file."""
    names = ",".join(f"q{i + 1}_deg" for i in range(poses.q.shape[1]))
    rows = (",".join(f"{angle:.6f}" for angle in row) for row in np.degrees(poses.q))
    path.write_text("\n".join([names, *rows]) + "\n")


def tip_error(true: CameraRig, fitted: Model, session: CameraSession, poses: Poses) -> float:
    """RMS (m) of a fitted model's tip at poses that it never saw, but for a rigid motion of all of them.

    The tip is the point of the board where the session has it; where camera and arm stand in the room is a convention.
    """
    tip = inverse(frame_motion(session.mount))[:3, 3]
    board = true.camera @ true.boards(solve_equilibrium(true.model, poses))
    truth = board[:, :3, :3] @ tip + board[:, :3, 3]
    found = solve_equilibrium(fitted, poses).tcp
    motion = similarity(found, truth, np.ones(len(found)), mirrored=False, scale=1.0)
    return error_stats(motion.apply(found) - truth).rms
