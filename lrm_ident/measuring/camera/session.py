"""Measurements by a camera: tool poses in the arm's frame with their covariance, and where camera and board stood."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lrm_ident.data.measurement_file.conventions import frame_motion, frame_table
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.orientations import POSE, Orientations
from lrm_ident.data.observations.positions import Positions
from lrm_ident.data.rigid_motion import inverse, placement_motion
from lrm_ident.data.source import Source
from lrm_ident.data.weights.whitening import Whitening, root_of
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.measuring.camera.board import MIRRORED, RejectedPhoto, read_picture
from lrm_ident.measuring.camera.board_pose import BoardPose, covariance_at, find_board
from lrm_ident.measuring.camera.capture import Picture
from lrm_ident.measuring.camera.consistency import PhotoRegression, board_scale, find_step, photo_regression
from lrm_ident.measuring.camera.hand_eye import HandEye, hand_eye, measured_covariance, mismatched_poses
from lrm_ident.measuring.camera.lens import Lens
from lrm_math.arm.arm import BASE, Arm, Placement
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import Poses
from lrm_math.model.reading import FrameTable
from lrm_math.toml_file import StrictSchema

LEVELLINGS, ENOUGH_TO_LEVEL = 3, 40
NEAREST, EDGE = 0.08, 15.0  # m; px
FACING = 0.35  # cosine of the angle between the line of sight and the board's normal
UNLIKE = np.radians(15.0)
"""A median turn between the poses photographed and those commanded that no assembled arm has."""


class CameraSession(StrictSchema):
    """Place of the camera (in the arm's frame) and the board on the tool; schema `lrm/camera-session/1`."""

    schema_: Literal["lrm/camera-session/1"] = Field(alias="schema")
    arm: str
    lens: Lens
    camera: FrameTable
    mount: FrameTable

    @property
    def motions(self) -> tuple[Array, Array]:
        """(4, 4) each, of the camera in the arm's frame and of the board in the tool's (m)."""
        return frame_motion(self.camera), frame_motion(self.mount)

    def seen(self, arm: Arm, poses: Poses) -> Array:
        """(N, 4, 4), the board in the camera's frame at commanded poses of the arm as drawn (m)."""
        camera, mount = self.motions
        return np.asarray(inverse(camera) @ tool_poses(arm, poses) @ mount)


@dataclass(frozen=True, eq=False)
class PhotoSet:
    """Photos taken at commanded poses: the rows of those that are of use, the board's poses, why others are not.

    `stands`, `rides`: in words, what stands beside the arm and what is on the tool.
    """

    rows: tuple[int, ...]
    boards: tuple[BoardPose, ...]
    refused: tuple[tuple[str, str], ...]
    stands: str = "camera"
    rides: str = "board"

    @property
    def from_gripper(self) -> PhotoSet:
        """The same photos if the camera is on the gripper and the board stands: what the camera's pose says of it."""
        boards = tuple(board.of_camera for board in self.boards)
        return replace(self, boards=boards, stands="board", rides="camera")


@dataclass(frozen=True, eq=False)
class CameraMeasurements:
    """Measurements of an arm by a camera, how it stood, and `refused` photos with the reason."""

    data: Measurements
    session: CameraSession
    photos: PhotoSet


def read_photos(files: Sequence[Path], lens: Lens) -> PhotoSet:
    """The board's pose in every photo that is of use. Raises `LrmError`: a picture of another size."""
    return read_pictures(((file.name, read_picture(file)) for file in files), lens)


def read_pictures(pictures: Iterable[tuple[str, Picture]], lens: Lens) -> PhotoSet:
    """The board's pose in every named picture that is of use. Raises `LrmError`: one of another size."""
    rows, boards, refused, mirrored = [], [], [], []
    for row, (name, picture) in enumerate(pictures):
        board_found = find_board(name, picture, lens)
        if isinstance(board_found, RejectedPhoto):
            refused.append((name, board_found.reason))
            mirrored += [name] if board_found == MIRRORED else []
        else:
            rows.append(row)
            boards.append(board_found)
    if len(mirrored) > (len(rows) + len(refused)) / 2:
        raise LrmError(f"{mirrored[0]} and {len(mirrored) - 1} more: {MIRRORED.reason}")
    return PhotoSet(tuple(rows), tuple(boards), tuple(refused))


def measure(arm: Arm, arm_name: str, poses: Poses, photos: PhotoSet, lens: Lens, path: Path) -> CameraMeasurements:
    """Measurements from photos at commanded poses (all of them, in the photos' order).

    Raises `LrmError`: too few photos, or photos that do not belong together (another board, a camera that moved, …).
    """
    taken = poses.take(np.array(photos.rows, dtype=np.int64))
    estimate = hand_eye(tool_poses(arm, taken), photos.boards)
    _check(photo_regression(arm, taken, estimate), photos, lens)
    for _ in range(LEVELLINGS if len(taken) >= ENOUGH_TO_LEVEL else 0):
        estimate = _levelled(arm, _measurements(taken, photos, estimate, path), estimate)
    data = _measurements(taken, photos, estimate, path)
    session = CameraSession(
        schema="lrm/camera-session/1",
        arm=arm_name,
        lens=lens,
        camera=_table(estimate.camera),
        mount=_table(estimate.mount),
    )
    return CameraMeasurements(data, session, photos)


def _levelled(arm: Arm, data: Measurements, estimate: HandEye) -> HandEye:
    """The camera placed by a fit of the arm's errors, so that axis 1 stands as drawn: level, as gravity is.

    The nominal arm alone places the camera some degrees askew, and gravity with it.
    """
    model = fit_identifiable(nominal_model(arm), data, nominal_model(arm).keys).fit.model
    keys = {name: f"offsets.{BASE}.{name}_{'mm' if len(name) == 1 else 'rad'}" for name in asdict(arm.base)}
    fitted = Placement(**{name: getattr(arm.base, name) + model.value(key) for name, key in keys.items()})
    back = placement_motion(arm.base) @ inverse(placement_motion(fitted))
    return replace(estimate, camera=back @ estimate.camera)


def _measurements(taken: Poses, photos: PhotoSet, estimate: HandEye, path: Path) -> Measurements:
    """Tool poses in the arm's frame and their covariance."""
    tool, covariance = estimate.tool, estimate.covariance
    number = np.array(photos.rows, dtype=np.int64) + 1
    position, turn, cross = covariance[:, :3, :3], covariance[:, 3:, 3:], covariance[:, 3:, :3]
    seen = (Positions(tool[:, :3, 3], blocks=position), Orientations(tool[:, :3, :3], blocks=turn, cross=cross))
    return Measurements(taken, seen, number, number, Source(path))


def tool_poses(arm: Arm, poses: Poses) -> Array:
    """(N, 4, 4), the tool's frame of the arm as drawn (m)."""
    chain = chain_of(arm)
    return frames(chain, chain.values(list(poses.q.T.copy())), len(poses))[:, -1]


def _check(photos: PhotoRegression, taken: PhotoSet, lens: Lens) -> None:
    """Raises `LrmError` if the photos do not belong together."""
    step = find_step(photos)
    if step is not None:
        first, other = taken.rows[step.before - 1] + 1, taken.rows[step.before] + 1
        what = f"the {taken.stands} moved" if step.what == "camera" else f"the {taken.rides} slipped on the tool"
        size = f"{step.shift * 1e3:.1f} mm and {np.degrees(step.turn):.2f} deg"
        raise LrmError(
            f"{what} between photos {first} and {other} (by about {size}); read the two parts apart, or measure again"
        )
    turn = float(np.median(np.linalg.norm(photos.residual[:, 3:], axis=1)))
    if turn > UNLIKE:
        raise mismatched_poses(f"{np.degrees(turn):.0f} deg")
    scale = board_scale(photos)
    if scale is not None:
        square = lens.board.square_mm
        raise LrmError(
            f"the board looks {100 * (scale[0] - 1):+.1f} ± {100 * scale[1]:.1f} % larger than stated: squares of "
            f"{square * scale[0]:.2f} mm instead of {square:g}; measure the printed line of 100 mm, and calibrate the "
            "lens with --square-mm as printed"
        )


def _table(T: Array) -> FrameTable:
    return frame_table(T[:3, :3], T[:3, 3])


def expected_covariance(session: CameraSession, arm: Arm, poses: Poses) -> Array:
    """(N, 6, 6), covariance with which a photo at commanded poses would give the tool's pose (m, rad)."""
    seen = session.seen(arm, poses)
    covariances = np.array([covariance_at(board, session.lens) for board in seen])
    return measured_covariance(*session.motions, seen, covariances)


def expected_weights(session: CameraSession, arm: Arm, poses: Poses) -> Whitening:
    """Weights with which photos at commanded poses would give the tool's pose, orientation included."""
    covariance = expected_covariance(session, arm, poses)
    sd = np.sqrt(np.einsum("nii->n", covariance[:, :3, :3]) / 3.0)
    return Whitening(sd, root_of(covariance), POSE)


def visible(session: CameraSession, arm: Arm, poses: Poses) -> NDArray[np.bool_]:
    """(N,), whether the camera sees the whole board, not too much from the side, at commanded poses."""
    lens, seen = session.lens, session.seen(arm, poses)
    corners = lens.board.corners @ seen[:, :3, :3].transpose(0, 2, 1) + seen[:, None, :3, 3]
    ahead = np.min(corners[:, :, 2], axis=1) > NEAREST
    pixels = lens.project(np.where(ahead[:, None, None], corners, [0.0, 0.0, 1.0]).reshape(-1, 3))[0]
    margin: Array = np.minimum(pixels, np.array(lens.size) - pixels).min(axis=1).reshape(len(seen), -1).min(axis=1)
    towards = np.einsum("ni,ni->n", seen[:, :3, 2], seen[:, :3, 3]) / np.linalg.norm(seen[:, :3, 3], axis=1)
    good: NDArray[np.bool_] = ahead & (margin > EDGE) & (towards > FACING)
    return good
