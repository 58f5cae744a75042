"""One joint's part in the motion of a tracked tip: its servo, the link behind it, and all links that it throws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.measuring.motion.joint_moves import JointMoves
from lrm_math.arrays import Array
from lrm_math.effects.base import Parameter
from lrm_math.effects.reference import ParameterRef
from lrm_math.motion.base import JointDrive, MotionEffect
from lrm_math.motion.effects import RestOffset, ServoResponse, Swing
from lrm_math.motion.links import LinksAlongPath
from lrm_math.motion.motion_model import MotionModel
from lrm_math.motion.simulation import simulate

LEAST_DAMPING = 0.5
"""Damping ratio of a servo, at least: a tip that swings may hang on a soft servo or on a soft link, and looks alike."""
UNSEEN_M = 3e-5
"""m RMS that a typical change of a parameter moves the tip, below which these moves do not show it."""
STIFF_HZ = 10.0
AT_ONCE = 8
"""Rows of parameters that are simulated at once: a bound on memory."""
Springs = Mapping[int, tuple[Array, Array]]
"""By joint (from 0): natural frequency (rad/s) and damping ratio of its link, (P,) each."""


def springs_of(model: MotionModel) -> Springs:
    """Springs of all joints whose link swings, (1,) each."""
    springs = {}
    for effect in model.effects:
        if isinstance(effect, Swing):
            hz, ratio = (np.array([model.values[key]]) for key in effect.keys[:2])
            springs[effect.joint] = 2.0 * np.pi * hz, ratio
    return springs


def servo_angle(effects: Sequence[MotionEffect], rows: Array, drive: JointDrive) -> Array:
    """(M + 1, P, S), rad, of a joint's servo for each row of parameters (P, p), those of a swing unused.

    No reading says where a joint stands before a move: it stands at its command, and its offset is added to all angles.
    """
    led, values, at, offset = [], [], 0, np.zeros((len(rows), 1))
    for effect in effects:
        columns = [rows[:, [k]] for k in range(at, at + len(effect.parameters))]
        at += len(columns)
        if isinstance(effect, RestOffset):
            offset = columns[0]
        elif not isinstance(effect, Swing):
            led.append(effect)
            values.append(columns)
    return simulate(led, values, drive) + offset


def with_links(links: LinksAlongPath, servos: Array, springs: Springs, h: float) -> Array:
    """(M + 1, P, S, n), rad, of the joints: servos (M + 1, P, S, n) and what the links swing behind them."""
    if not springs:
        return servos
    soft = sorted(springs)
    P = servos.shape[1]
    omega, ratio = (np.stack([np.broadcast_to(springs[j][k], P) for j in soft], axis=1) for k in (0, 1))
    out = servos.copy()
    out[..., soft] += links.deflections(servos, soft, omega, ratio, h)
    return out


@dataclass(frozen=True, eq=False)
class TipJoint(JointMoves):
    """`target`: (S, T, 3), m, the tip, less that at the linearisation, plus `levers` times the angles there.

    Attributes:
        joint: from 0. levers: (S, T, 3, n), m/rad, of all joints. servos: (M + 1, S, n), rad, of all joints' servos as
            predicted. springs: of the other joints.
    """

    joint: int
    levers: Array
    servos: Array
    links: LinksAlongPath
    springs: Springs

    def take(self, rows: NDArray[np.bool_]) -> TipJoint:
        """Some of the moves; `rows`: (S,)."""
        return replace(
            self, drive=self.drive.take(rows), target=self.target[rows], lever=self.lever[rows],
            beside=self.beside[rows], counted=self.counted[rows], fold=self.fold[rows], levers=self.levers[rows],
            servos=self.servos[:, rows], links=self.links.take(rows),
        )  # fmt: skip

    def lower(self, effect: MotionEffect, parameter: Parameter) -> float:
        """Least value of a parameter (SI): a servo is damped."""
        damped = isinstance(effect, ServoResponse) and parameter.name == "damping_ratio"
        return LEAST_DAMPING if damped else parameter.lower

    def start(self, values: Mapping[str, float], added: MotionEffect) -> Mapping[str, float]:
        """With a stiff servo where the link swings: one that was fitted without the swing is as soft as that."""
        if not isinstance(added, Swing):
            return values
        hz, ratio = (str(ParameterRef(ServoResponse.id, added.place, p.name)) for p in ServoResponse.parameters)
        return {**values, hz: STIFF_HZ, ratio: 1.0}

    def missed(self, effects: Sequence[MotionEffect], rows: Array) -> Array:
        """(P, S, T, 3), m."""
        parts = [self._missed(effects, rows[k : k + AT_ONCE]) for k in range(0, len(rows), AT_ONCE)]
        return np.concatenate(parts)

    def _missed(self, effects: Sequence[MotionEffect], rows: Array) -> Array:
        servos = np.repeat(self.servos[:, None], len(rows), axis=1)
        servos[..., self.joint] = servo_angle(effects, rows, self.drive)
        springs, at = dict(self.springs), 0
        for effect in effects:
            if isinstance(effect, Swing):
                springs[self.joint] = 2.0 * np.pi * rows[:, at], rows[:, at + 1]
            at += len(effect.parameters)
        q = with_links(self.links, servos, springs, self.drive.h)[:: self.substeps]
        return np.asarray(self.target - np.einsum("stan,tpsn->psta", self.levers, q, optimize=True))

    def derivatives(self, effects: Sequence[MotionEffect], values: Mapping[str, float], difference: float) -> Array:
        """(S, T, 3, p), of the tip (m) by the effects' parameters (SI); `difference`: in typical sizes."""
        current = np.array([values[key] for effect in effects for key in effect.keys])
        parameters = [parameter for effect in effects for parameter in effect.parameters]
        step = difference * np.array([p.typical for p in parameters])
        side = np.where(current + step > [p.upper for p in parameters], -step, step)
        missed = self.missed(effects, np.concatenate([current[None], current + np.diag(side)]))
        columns = np.moveaxis((missed[0] - missed[1:]) / side[:, None, None, None], 0, 3)
        seen = np.sqrt(np.mean(columns[self.counted] ** 2, axis=(0, 1))) * [p.typical for p in parameters] > UNSEEN_M
        return np.asarray(np.where(seen, columns, 0.0))
