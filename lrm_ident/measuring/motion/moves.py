"""Moves of a recording: pieces of its episodes, each predicted from its beginning and its commands alone.

A move begins three to six seconds before its readings count (half a second at the beginning of an episode): what the
joint did before is then in the model's state, too. No reading shows how far a limited set-point is ahead of its joint,
or at what speed a swing begins, so moves begin where the arm is slowest, and what is left of an error there fades.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from lrm_ident.measuring.motion.joint_moves import JointMoves, predicted
from lrm_ident.measuring.recordings.lerobot import LeRobotFrames
from lrm_math.arm.arm import Arm
from lrm_math.arm.servo_settings import ServoSettings
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.motion.base import JointDrive
from lrm_math.motion.effects import RestOffset
from lrm_math.motion.loads import JointLoads, joint_loads, reference_inertia
from lrm_math.motion.motion_model import MotionModel

LEAD_S, LONGEST_LEAD_S, SHORTEST_S, LONGEST_S = 0.5, 6.0, 3.0, 6.0
LEAST_MOTION = np.radians(5.0)
"""rad, over which some joint is commanded; radians that are read as degrees are less."""
STEP_S = 0.0085
"""Longest step of the simulation: an eighth of the period of the fastest servo that the catalogue allows."""
FOLDS = 5
STILL_S, STILL, FOLLOWED_S = 0.3, np.radians(0.3), 0.25
"""s and rad of a stop; s for which a joint follows a tremor of its command."""
ENCODER_SD = np.radians(360.0 / 4096.0) / np.sqrt(12.0)
FASTEST_GAP = 1.5
"""Times the usual distance of frames that a gap may have."""
LEAST_MOVES = 2 * FOLDS
MOVING, MANY = np.radians(5.0), 0.1
"""rad/s from which on an arm moves; share of moves that begin so of which a person is told."""
RESTING, WITHIN = 4, 4.0
"""Readings that are alike, to so many times their noise, where a joint rests."""


@dataclass(frozen=True, eq=False)
class Moves:
    """S moves of T frames each, `dt` s apart, of the n joints of an arm; shorter ones are padded.

    Attributes:
        command, reading: (S, T, n), rad; of a frame the angle that was read, and that which was then commanded.
        told: (S, (T − 1) substeps, n), rad, commanded at every step of the simulation.
        counted: (S, T), frames whose readings count. episode: (S,). noise: (n,), standard deviation of a reading (rad).
        path: (S, T, n), rad, along which the loads are taken: where the arm is, as far as known without its readings.
        name: of the recording. notices: what a person should know of it. servos: how they were set, None: not known.
    """

    arm: Arm
    dt: float
    command: Array
    told: Array
    reading: Array
    counted: NDArray[np.bool_]
    episode: NDArray[np.int64]
    noise: Array
    path: Array
    name: str
    notices: tuple[str, ...] = ()
    servos: ServoSettings | None = None

    unit: ClassVar[Literal["deg", "mm"]] = "deg"
    """In which people read an error."""
    evaluations: ClassVar[int] = 25
    """Of a joint's fit, at most."""
    scale: ClassVar[float] = float(np.degrees(1.0))
    """Of errors (rad, m) in this unit."""

    def __len__(self) -> int:
        return len(self.command)

    @property
    def substeps(self) -> int:
        """Steps of the simulation to a frame."""
        return steps_of(self.dt)

    @cached_property
    def fold(self) -> NDArray[np.int64]:
        """(S,), part of the cross-validation: whole episodes, or, of fewer than five, neighbouring moves."""
        _, number = np.unique(self.episode, return_inverse=True)
        if number.max() + 1 >= FOLDS:
            return np.asarray(number % FOLDS)
        return np.arange(len(self)) * FOLDS // len(self)

    @cached_property
    def loads(self) -> JointLoads:
        """Torques and inertia along the path."""
        return joint_loads(self.arm, self.path, self.dt)

    @cached_property
    def reference(self) -> Array:
        """(n,), moments of inertia in the middle of all ranges (kg m²)."""
        return reference_inertia(self.arm)

    def drive(self, joint: int) -> JointDrive:
        """What a joint from 0 is told and bears, at the steps of the simulation; loads are straight between frames."""
        n, loads = self.substeps, self.loads
        command = self.told[:, :, joint].T
        gravity, reaction, inertia = (
            between(x[:, :, joint], n) for x in (loads.gravity, loads.reaction, loads.inertia)
        )
        return JointDrive(
            self.dt / n, command, gravity, reaction, inertia, float(self.reference[joint]), *self.start(joint)
        )

    def measured(self, model: MotionModel, joints: Sequence[int]) -> list[JointMoves]:
        """What was measured of some joints (from 0): their encoders, whatever the model says of the others."""
        del model
        return [
            JointMoves(
                self.drive(joint), target, np.ones_like(target), np.empty((*target.shape, 0)), self.counted,
                self.substeps, self.fold,
            )
            for joint in joints
            for target in [self.reading[:, :, [joint]]]
        ]  # fmt: skip

    def beside_command(self, joint: int) -> Array:
        """(N,), readings less commands of a joint (rad) at the frames that count."""
        return np.asarray((self.reading - self.command)[self.counted][:, joint])

    def told_and_read(self, joint: int) -> tuple[Array, Array]:
        """(S, T, m) each, what a joint's encoder would read of the commands (rad), and what it read."""
        return self.command[:, :, [joint]], self.reading[:, :, [joint]]

    def fitted_with(self, joint: int) -> Sequence[int]:
        """Joints (from 0) that are fitted anew where the effects of one change."""
        return [joint]

    def tuned(self, model: MotionModel) -> tuple[Self, MotionModel]:
        """The same along the model's path, and the model; encoders are fitted joint by joint."""
        return self.along(model), model

    def along(self, model: MotionModel) -> Self:
        """The same, loads taken along the path that a model predicts, offsets of readings left out."""
        path = []
        for joint in range(self.arm.dof):
            effects = [effect for effect in model.of_joint(joint) if not isinstance(effect, RestOffset)]
            values = np.array([[model.values[key] for effect in effects for key in effect.keys]])
            path.append(predicted(effects, values, self.drive(joint), self.substeps)[0])
        return replace(self, path=np.stack(path, axis=2))

    def start(self, joint: int) -> tuple[Array, Array]:
        """(S,) each, reading and speed at the beginning (rad, rad/s): of the first two readings; at rest their mean."""
        lead = self.reading[:, : round(LEAD_S / self.dt), joint]
        near = np.abs(lead - lead[:, :1]) < WITHIN * self.noise[joint]
        still = np.cumprod(near, axis=1).astype(np.float64)
        rests = still.sum(axis=1) >= RESTING
        mean = np.sum(still * lead, axis=1) / still.sum(axis=1)
        return np.where(rests, mean, lead[:, 0]), np.where(rests, 0.0, (lead[:, 1] - lead[:, 0]) / self.dt)


def between(values: Array, n: int) -> Array:
    """((T − 1) n, S), values (S, T) in the middle of each of n steps from frame to frame."""
    share = (np.arange(n) + 0.5) / n
    steps = values[:, :-1, None] + share * np.diff(values, axis=1)[:, :, None]
    return np.asarray(steps.reshape(len(values), -1).T)


def steps_of(dt: float) -> int:
    """Steps of the simulation to a frame (s)."""
    return int(np.ceil(dt / STEP_S))


def moves_of(frames: LeRobotFrames, arm: Arm, path: Path) -> Moves:
    """The moves of a recording. Raises `FileError`: gaps, too short, or joints without numbers."""
    if frames.missing.any():
        raise FileError(path, "", f"{int(frames.missing.any(axis=1).sum())} frames lack a number", "record them again")
    dt = _frame_distance(frames, path)
    speeds = [(frames.reading_speed(rows), rows) for rows in _episodes(frames)]
    rows, counted = cut(path, dt, speeds)
    if np.array_equal(frames.command, frames.feedback):
        raise FileError(path, "", "encoders that read exactly what is commanded", "readings of the encoders")
    if (largest := np.ptp(frames.command, axis=0).max()) < LEAST_MOTION:
        what = f"no joint is commanded over more than {np.degrees(largest):.2g} deg"
        raise FileError(path, "", what, "quick and slow moves; or are the angles in rad (--angle-unit)?")
    began = begun_in_motion(np.concatenate([speed for speed, _ in speeds])[rows[:, 0]] > MOVING * dt)
    command = frames.command[rows]
    smooth = followed(command, dt)
    told = np.repeat(command[:, :-1], steps_of(dt), axis=1)  # a command stays until the next frame
    return Moves(
        arm, dt, command, told, frames.feedback[rows], counted, frames.episode[rows[:, 0]], _noise(frames, dt), smooth,
        path.name, (*frames.notices, *began),
    )  # fmt: skip


def begun_in_motion(moving: NDArray[np.bool_]) -> tuple[str, ...]:
    """Notice where more than a tenth of the moves begin while the arm moves; `moving`: (S,), whether one does."""
    count, share = int(moving.sum()), float(moving.mean())
    words = f"{count} of {len(moving)} moves begin while the arm moves: let it stand for a second after each move"
    return (words,) if share > MANY else ()


def cut(
    path: Path, dt: float, episodes: Sequence[tuple[Array, NDArray[np.int64]]]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Frames (S, T) of the moves, the last repeated in shorter ones, and which of them count.

    `episodes`: how unfit for a cut each frame of an episode is, and its number.
    Raises `FileError`: too few moves.
    """
    all_pieces = [piece for unfit, rows in episodes for piece in _pieces(unfit, rows, dt)]
    pieces, leads = [piece for piece, _ in all_pieces], [lead for _, lead in all_pieces]
    if len(pieces) < LEAST_MOVES:
        what = f"{len(pieces)} moves of {SHORTEST_S:g} to {LONGEST_S:g} s"
        raise FileError(path, "", what, f"{LEAST_MOVES} at least: about a minute of motion")
    T = max(len(piece) for piece in pieces)
    rows = np.array([np.pad(piece, (0, T - len(piece)), mode="edge") for piece in pieces])
    k, length = np.arange(T), np.array([len(piece) for piece in pieces])
    return rows, (k >= np.array(leads)[:, None]) & (k < length[:, None])


def _frame_distance(frames: LeRobotFrames, path: Path) -> float:
    """s, between frames. Raises `FileError`: they are not evenly apart."""
    same = np.diff(frames.episode) == 0
    gaps = np.diff(frames.t)[same]
    if not len(gaps):
        raise FileError(path, "timestamp", "no two frames of one episode", "an episode of some seconds")
    dt = float(np.median(gaps))
    if not dt > 0.0 or gaps.max() > FASTEST_GAP * dt or gaps.min() < (2.0 - FASTEST_GAP) * dt:
        what = f"frames {1e3 * gaps.min():.0f} to {1e3 * gaps.max():.0f} ms apart"
        raise FileError(path, "timestamp", what, "frames evenly apart, as LeRobot records them")
    return dt


def _episodes(frames: LeRobotFrames) -> list[NDArray[np.int64]]:
    return np.split(np.arange(len(frames.t)), np.flatnonzero(np.diff(frames.episode)) + 1)


def _pieces(unfit: Array, rows: NDArray[np.int64], dt: float) -> list[tuple[NDArray[np.int64], int]]:
    """Frames of each move of an episode, its lead included, and the frames of the lead."""
    lead, most, shortest, longest = (round(s / dt) for s in (LEAD_S, LONGEST_LEAD_S, SHORTEST_S, LONGEST_S))
    least = max(lead, most // 2)
    out, begin = [], lead
    while len(rows) - begin >= shortest:
        rest = len(rows) - begin
        cut = rest if rest <= longest else shortest + int(np.argmin(unfit[begin + shortest : begin + longest]))
        if rest - cut < shortest and rest <= shortest + longest and rest > longest:
            cut = rest // 2
        latest = max(begin - least, 0)
        stillest = begin - latest + int(np.argmin(unfit[max(begin - most, 0) : latest + 1][::-1]))
        out.append((rows[begin - stillest : begin + cut], stillest))
        begin += cut
    return out


def followed(command: Array, dt: float, lag: float = 0.1) -> Array:
    """(S, T, n), the command behind a first-order lag (s): about where an arm is."""
    out, share = np.empty_like(command), 1.0 - np.exp(-dt / lag)
    position = command[:, 0]
    for k in range(command.shape[1]):
        out[:, k] = position
        position = position + share * (command[:, k] - position)
    return out


def _noise(frames: LeRobotFrames, dt: float) -> Array:
    """(n,), rad: scatter of the readings where nothing moves, by second differences; at least an encoder's rounding.

    A hand trembles at stops, too, and a servo that leads follows it: what follows linearly of the command is left out.
    """
    width, lags = max(4, round(STILL_S / dt)), round(FOLLOWED_S / dt)
    bends, causes = [], []
    for rows in _episodes(frames):
        if len(rows) < width:
            continue
        seen, told = (sliding_window_view(x[rows], width, axis=0) for x in (frames.feedback, frames.command))
        still = (np.ptp(told, axis=2) < STILL).all(axis=1) & (np.ptp(seen, axis=2) < 2.0 * STILL).all(axis=1)
        at = np.flatnonzero(still) + width - 3  # the last second difference of each window
        bend, cause = (np.diff(x[rows], n=2, axis=0) for x in (frames.feedback, frames.command))
        before = np.concatenate([np.zeros((lags, cause.shape[1])), cause])
        bends.append(bend[at])
        causes.append(np.stack([before[at + lags - lag] for lag in range(lags + 1)], axis=1))
    n = frames.feedback.shape[1]
    seen, told = np.concatenate([*bends, np.empty((0, n))]), np.concatenate([*causes, np.empty((0, lags + 1, n))])
    scatter = [np.sqrt(_unexplained(told[:, :, joint], seen[:, joint]) / 6.0) for joint in range(n)]
    return np.asarray(np.maximum(scatter, ENCODER_SD))


def _unexplained(columns: Array, values: Array) -> float:
    """Mean square of values (N,) that columns (N, k) do not explain; 0 of too few."""
    if len(values) <= 2 * columns.shape[1]:
        return 0.0
    solution, _, rank, _ = np.linalg.lstsq(columns, values, rcond=None)
    return float(np.sum((values - columns @ solution) ** 2) / (len(values) - rank))
