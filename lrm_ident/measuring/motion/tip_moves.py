"""Moves of an arm without encoders: a tracker measured its tip while the commands were logged.

The tip moves with all joints. With q(t) the predicted angles, J(t) the tip's derivatives and e the remaining error,
one joint's effects see the target e + Jᵢ qᵢ, to first order; what other joints' parameters, the tracker's place, the
body's place at the tip and the offset of the two clocks would change is projected out of it (`joint_moves`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal, Self

import numpy as np

from lrm_ident.data.rigid_motion import skew
from lrm_ident.measuring.motion.joint_fit import DIFFERENCE
from lrm_ident.measuring.motion.joint_moves import RANK, JointMoves
from lrm_ident.measuring.motion.moves import LEAD_S, Moves, begun_in_motion, cut, followed, steps_of
from lrm_ident.measuring.motion.tip_joint import TipJoint, servo_angle, springs_of, with_links
from lrm_ident.measuring.recordings.command_log import CommandLog
from lrm_ident.measuring.recordings.take import TipTrack
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.kinematics.chain import Chain
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.motion.effects import RestOffset
from lrm_math.motion.links import LinksAlongPath
from lrm_math.motion.motion_model import MotionModel

GRID_S = 0.02
"""s between the instants at which speeds of two clocks are compared."""
GAP_S = 0.1
"""s between two frames of the tracker beyond which the tip between them is not known."""
ALIKE = 0.5
"""Least correlation of the tip's speed with that of the commands at which both are of one motion."""
ITERATIONS, ENOUGH = 8, 0.003
"""Steps of the fit of all joints, and the relative fall of squared error below which it ends."""
LEAST_DAMPING_OF_STEPS = 1e-3
"""Of Levenberg–Marquardt at the beginning, in columns of unit length."""


@dataclass(frozen=True, eq=False)
class Installation:
    """Where the tracker and its body are.

    Attributes:
        rotation, shift: (3, 3), (3,), m: of the arm's frame in the tracker's. body: (3,), m, of what is tracked in the
            tool's frame. late: s to add to the commands' clock to get the tracker's.
    """

    rotation: Array
    shift: Array
    body: Array
    late: float


@dataclass(frozen=True, eq=False, kw_only=True)
class TipMoves(Moves):
    """Moves whose tip was tracked; of a joint no reading exists, and `reading` repeats the command.

    Attributes:
        rests: amounts of all slots (rad, m) where the arm comes to rest, without the joints' angles, each (S T,).
        track: the tracker's recording. t: (S, T), s, of each frame by the commands' clock. installation: as far as
            known.
    """

    chain: Chain
    rests: tuple[Array, ...]
    track: TipTrack
    t: Array
    installation: Installation

    unit: ClassVar[Literal["deg", "mm"]] = "mm"
    scale: ClassVar[float] = 1.0 / MM
    evaluations: ClassVar[int] = 3  # all joints were fitted together before

    @cached_property
    def tip(self) -> Array:
        """(S, T, 3), m, in the tracker's frame."""
        return self.track.at(self.t + self.installation.late)

    def measured(self, model: MotionModel, joints: Sequence[int]) -> list[JointMoves]:
        """The tip as each of some joints moves it, all else to first order about the model's prediction."""
        q, alone = self._predicted(model)
        columns, static = _derivatives(model, alone), self._tips(q)[2]
        return [
            replace(alone[joint], beside=np.concatenate([static, *columns[:joint], *columns[joint + 1 :]], axis=3))
            for joint in joints
        ]

    def tuned(self, model: MotionModel) -> tuple[Self, MotionModel]:
        """Moves and model after a few steps of Levenberg–Marquardt in all joints' parameters and the installation."""
        moves, damping = self.along(model), LEAST_DAMPING_OF_STEPS
        q, alone = moves._predicted(model)
        error = (moves.tip - moves._tips(q)[0])[moves.counted].reshape(-1)
        for _ in range(ITERATIONS):
            columns, static = _derivatives(model, alone), moves._tips(q)[2]
            A = np.concatenate([static, *columns], axis=3)[moves.counted].reshape(len(error), -1)
            scale = np.linalg.norm(A, axis=0)
            scale[scale == 0.0] = 1.0
            normal, pull = (A / scale).T @ (A / scale), (A / scale).T @ error
            step = np.linalg.solve(normal + damping * np.eye(len(normal)), pull) / scale
            trial = _changed(model, alone, step[static.shape[3] :])
            new_moves = moves.along(trial)
            new_q, new_alone = new_moves._predicted(trial)
            unexplained = (new_moves.tip - new_moves._tips(new_q)[0])[moves.counted].reshape(-1)
            if unexplained @ unexplained >= error @ error:
                damping *= 10.0
                continue
            done = unexplained @ unexplained > (1.0 - ENOUGH) * (error @ error)
            moves, model, q, alone, error, damping = new_moves, trial, new_q, new_alone, unexplained, 0.2 * damping
            if done:
                break
        return moves, model

    def _predicted(self, model: MotionModel) -> tuple[Array, list[TipJoint]]:
        """Angles (S, T, n), rad, that a model predicts, and what each joint does beside the others' as predicted."""
        links = LinksAlongPath.of(self.arm, self.path, self.substeps)
        drives = [self.drive(joint) for joint in range(self.arm.dof)]
        effects = [model.of_joint(joint) for joint in range(self.arm.dof)]
        values = [
            np.array([[model.values[key] for effect in effects_of_joint for key in effect.keys]])
            for effects_of_joint in effects
        ]
        moved = [servo_angle(*row)[:, 0] for row in zip(effects, values, drives, strict=True)]
        servos, springs = np.stack(moved, axis=2), springs_of(model)
        q = with_links(links, servos[:, None], springs, drives[0].h)[:: self.substeps, 0].swapaxes(0, 1)
        tip, levers, _ = self._tips(q)
        reached = self.tip - tip + np.einsum("stan,stn->sta", levers, q)
        alone = [
            TipJoint(
                drives[joint], reached, levers[..., joint], np.empty((*reached.shape, 0)), self.counted, self.substeps,
                self.fold, joint, levers, servos, links, {k: v for k, v in springs.items() if k != joint},
            )
            for joint in range(self.arm.dof)
        ]  # fmt: skip
        return q, alone

    def beside_command(self, joint: int) -> Array:
        """(N,), tip less that of the commands (m), whatever the joint."""
        del joint
        return np.asarray((self.tip - self._tips(self.command)[0])[self.counted]).reshape(-1)

    def told_and_read(self, joint: int) -> tuple[Array, Array]:
        """(S, T, 3) each, tip of the commands, and the tracked one, in the tracker's frame (m), whatever the joint."""
        del joint
        return self._tips(self.command)[0], self.tip

    def fitted_with(self, joint: int) -> Sequence[int]:
        """All joints: the tip moves with each of them."""
        del joint
        return range(self.arm.dof)

    def along(self, model: MotionModel) -> Self:
        """The same, along the model's path, and the installation as this path shows it."""
        q, _ = self._predicted(model)
        offset = np.zeros(self.arm.dof)
        for effect in model.effects:
            if isinstance(effect, RestOffset):
                offset[effect.joint] = model.values[effect.keys[0]]
        shifted = replace(self, path=q - offset)
        for _ in range(ITERATIONS // 2):
            shifted = shifted._installed(q)
        return shifted

    def _tips(self, q: Array) -> tuple[Array, Array, Array]:
        """Tips (S, T, 3) at angles (S, T, n), rad, their derivatives by these, (S, T, 3, n), and by the installation,
        (S, T, 3, 10): shift, turn, body and clock; in the tracker's frame, m."""
        shape, place, chain = q.shape[:2], self.installation, self.chain
        values = list(self.rests)
        for joint, slot in enumerate(chain.joint_slots):
            values[slot] = values[slot] + q[:, :, joint].reshape(-1)
        geometry = chain_geometry(chain, values, shape[0] * shape[1])
        columns = geometry.tool[:3].transpose(2, 1, 0)  # (N, 3, 3)
        reached = geometry.tcp.T + columns @ place.body
        slots = list(chain.joint_slots)
        axis, origin = geometry.axis[slots].transpose(2, 0, 1), geometry.origin[slots].transpose(2, 0, 1)
        levers = place.rotation @ np.cross(axis, reached[:, None] - origin).transpose(0, 2, 1)
        turned = reached @ place.rotation.T
        tip = (turned + place.shift).reshape(*shape, 3)
        steady = np.broadcast_to(np.eye(3), (len(turned), 3, 3))
        speed = np.gradient(tip, self.dt, axis=1).reshape(-1, 3, 1)
        static = np.concatenate([steady, -skew(turned), place.rotation @ columns, -speed], axis=2)
        return tip, levers.reshape(*shape, 3, -1), static.reshape(*shape, 3, -1)

    def _installed(self, q: Array) -> Self:
        """The installation changed so that tips at angles (S, T, n) come nearest to the measured ones."""
        tip, _, static = self._tips(q)
        A, error = static[self.counted].reshape(-1, static.shape[3]), (self.tip - tip)[self.counted].reshape(-1)
        scale = np.linalg.norm(A, axis=0)
        change = np.linalg.lstsq(A / scale, error, rcond=RANK)[0] / scale
        installation, turn = self.installation, skew(change[3:6])
        rotation, _ = np.linalg.qr((np.eye(3) + turn) @ installation.rotation)
        rotation = rotation * np.sign(np.sum(rotation * ((np.eye(3) + turn) @ installation.rotation), axis=0))
        place = Installation(
            rotation,
            installation.shift + change[:3],
            installation.body + change[6:9],
            installation.late + float(change[9]),
        )
        noise = np.full(self.arm.dof, self.track.noise_at(self.t + place.late))
        return replace(self, installation=place, noise=noise)


def _derivatives(model: MotionModel, alone: Sequence[TipJoint]) -> list[Array]:
    """(S, T, 3, p) of each joint, of the tip (m) by its parameters (SI)."""
    return [
        joint_alone.derivatives(model.of_joint(joint), model.values, DIFFERENCE)
        for joint, joint_alone in enumerate(alone)
    ]


def _changed(model: MotionModel, alone: Sequence[TipJoint], change: Array) -> MotionModel:
    """The model with all joints' parameters, in order, changed (SI) within their bounds."""
    values, at = dict(model.values), 0
    for joint, joint_alone in enumerate(alone):
        for effect in model.of_joint(joint):
            for key, parameter in zip(effect.keys, effect.parameters, strict=True):
                values[key] = float(
                    np.clip(values[key] + change[at], joint_alone.lower(effect, parameter), parameter.upper)
                )
                at += 1
    return replace(model, values=values)


def tip_moves(log: CommandLog, track: TipTrack, poses: Model) -> TipMoves:
    """The moves of a log of commands and a tracker's recording of the same minutes, by two clocks.

    Raises `FileError`: another motion, too short, or the tip was hardly seen.
    """
    dt = track.frame_s
    late = _clock_offset(log, track, poses)
    begin, end = max(log.t[0], track.t[0] - late), min(log.t[-1], track.t[-1] - late)
    t = begin + dt * np.arange(int((end - begin) / dt) - 1)
    if len(t) < LEAD_S / dt:
        raise FileError(track.path, "", "it and the log of commands have no minute in common", "record both at once")
    command = log.at(t)
    stood = _stood(command, dt)
    rows, counted = cut(track.path, dt, [(-stood, np.arange(len(t)))])
    steps = steps_of(dt)
    middle = t[rows][:, :-1, None] + dt * (np.arange(steps) + 0.5) / steps
    told = log.at(middle.reshape(len(rows), -1))
    seen = track.seen(t[rows] + late, GAP_S)
    path = followed(command[rows], dt)
    n, noise = poses.arm.dof, track.noise
    nowhere = Installation(np.eye(3), np.zeros(3), np.zeros(3), late)
    moves = TipMoves(
        poses.arm, dt, command[rows], told, command[rows], counted & seen, np.zeros(len(rows), dtype=np.int64),
        np.full(n, noise), path, f"{log.path.name} and {track.path.name}",
        (f"the tracker's clock is {late:.3f} s ahead of the commands'", *begun_in_motion(stood[rows[:, 0]] < LEAD_S)),
        chain=poses.chain, rests=_rests(poses, command[rows]), track=track, t=t[rows], installation=nowhere,
    )  # fmt: skip
    moves = replace(moves, installation=_registered(moves))
    for _ in range(ITERATIONS):
        moves = moves._installed(path)
    return moves


def _rests(poses: Model, command: Array) -> tuple[Array, ...]:
    q = command.reshape(-1, poses.arm.dof)
    slots = [np.broadcast_to(a, len(q)) for a in solve_equilibrium(poses, Poses(q, np.zeros(len(q)))).slots]
    for joint, slot in enumerate(poses.chain.joint_slots):
        slots[slot] = slots[slot] - q[:, joint]
    return tuple(np.asarray(slot) for slot in slots)


def _stood(command: Array, dt: float) -> Array:
    """(N,), s for which the command (N, n) has stood."""
    moves = np.concatenate([[True], np.abs(np.diff(command, axis=0)).max(axis=1) > 1e-6])
    last = np.maximum.accumulate(np.where(moves, np.arange(len(moves)), 0))
    return np.asarray(dt * (np.arange(len(moves)) - last))


def _clock_offset(log: CommandLog, track: TipTrack, poses: Model) -> float:
    """s to add to the commands' clock to get the tracker's: where the speeds of both tips agree best (correlation)."""
    times, seen = np.arange(log.t[0], log.t[-1], GRID_S), np.arange(track.t[0], track.t[-1], GRID_S)
    q = followed(log.at(times)[None], GRID_S)[0]
    chain = poses.chain
    drawn = chain_geometry(chain, chain.values(list(q.T)), len(q)).tcp.T
    a, b = (_speed(x) for x in (drawn, track.at(seen)))
    size = 1 << int(np.ceil(np.log2(len(a) + len(b))))
    both = np.fft.irfft(np.fft.rfft(b, size) * np.conj(np.fft.rfft(a, size)), size)
    lag = int(np.argmax(both))
    lag = lag - size if lag > size // 2 else lag
    first, last = max(0, -lag), min(len(a), len(b) - lag)
    common = (a[first:last], b[first + lag : last + lag])
    scale = float(np.linalg.norm(common[0]) * np.linalg.norm(common[1]))
    if not scale > 0.0 or common[0] @ common[1] < ALIKE * scale:
        what = "the tip's speed does not follow that of the commands, at any offset of the clocks"
        raise FileError(track.path, "", what, "a recording of the motion that the log is of, of the body at the tip")
    return float(seen[0] - times[0] + lag * GRID_S)


def _speed(tip: Array) -> Array:
    """(N,), speed of a tip (N, 3) over a few instants, less its mean."""
    moved = np.convolve(np.linalg.norm(np.diff(tip, axis=0), axis=1), np.ones(5) / 5.0, "same")
    return np.asarray(moved - moved.mean())


def _registered(moves: TipMoves) -> Installation:
    """Rotation and shift by Kabsch (1976), without the body's place."""
    drawn, _, _ = moves._tips(moves.path)
    a, b = drawn[moves.counted], moves.tip[moves.counted]
    U, _, Vt = np.linalg.svd((b - b.mean(axis=0)).T @ (a - a.mean(axis=0)))
    rotation = U @ np.diag([1.0, 1.0, float(np.sign(np.linalg.det(U @ Vt)))]) @ Vt
    return replace(moves.installation, rotation=rotation, shift=b.mean(axis=0) - rotation @ a.mean(axis=0))
