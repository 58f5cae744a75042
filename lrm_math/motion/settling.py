"""How long an arm swings after a move: the time until the tip stays near where it comes to rest."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.motion.base import JointDrive, MotionEffect
from lrm_math.motion.effects import ServoResponse, Swing
from lrm_math.motion.loads import joint_loads, reference_inertia
from lrm_math.motion.modes import Modes, modes_at
from lrm_math.motion.motion_model import MotionModel
from lrm_math.motion.simulation import simulate
from lrm_math.motion.swing_along import swing_along

STEP_S = 0.005
"""s, of the simulation."""
FADED, SHORTEST_S, LONGEST_S = 8.0, 2.0, 30.0
"""A move is followed after its end until what fades most slowly has faded by exp(−8), within these bounds (s)."""


@dataclass(frozen=True)
class Settling:
    """Time (s) from the end of a commanded move until the tip stays within a distance; the joint (from 0) that moves
    the tip most at the last."""

    seconds: float
    joint: int


def settling(model: MotionModel, start: Array, goal: Array, speed: float, within: float) -> Settling:
    """Of a straight move in joint space at a speed (rad/s of the fastest joint) from `start` to `goal` (n,), rad.

    `within`: m.
    """
    ramp = max(int(np.ceil(np.abs(goal - start).max() / speed / STEP_S)), 1)
    share = np.arange(1, ramp + 1)[:, None] / ramp
    return settling_after(model, start, (start + share * (goal - start))[None], STEP_S, within)[0]


def settling_after(
    model: MotionModel,
    start: Array,
    paths: Array,
    step: float,
    within: float,
    payload: float = 0.0,
    frequency_factors: tuple[float, ...] = (1.0,),
    shares: tuple[float, ...] = (1.0,),
) -> tuple[Settling, ...]:
    """Of commanded angles `paths` (B, M, n), rad, each constant over a step (s), from rest at `start` (n,).

    All paths end at one posture; each is tried with each of the factors of the natural frequencies. There is an answer
    for each of `shares`: by then it has settled in that share of these cases. `within`: m; `payload`: kg. The tip's
    deviation is that of the joints' by the Jacobian at the end of the path.
    """
    goal, length = paths[0, -1], paths.shape[1]
    modes = modes_at(model, goal, payload)
    after = round(float(np.clip(FADED / _slowest_fading(model, modes), SHORTEST_S, LONGEST_S)) / step)
    moved = _moved(model, np.concatenate([paths, np.tile(goal, (len(paths), after, 1))], axis=1), start, step)
    swung = swing_along(model, moved, step, frequency_factors, payload, length)
    away = (moved[:, None] + swung - moved[-1]).reshape(len(moved), -1, len(goal))
    jacobian = tip_jacobian(model, goal)
    far = ~(np.linalg.norm(away[length:] @ jacobian, axis=2) <= within)  # what is no number is not near
    steps = np.where(far.any(axis=0), len(far) - np.argmax(far[::-1], axis=0), 0)
    out, order = [], np.argsort(steps)
    for case in (int(order[math.ceil(share * len(steps)) - 1]) for share in shares):
        begin = length + max(int(steps[case]) - 1, 0)
        ends = away[begin : begin + max(1, round(0.5 / step)), case, :, None] * jacobian
        out.append(Settling(float(steps[case] * step), int(np.argmax(np.linalg.norm(ends, axis=2).max(axis=0)))))
    return tuple(out)


def _slowest_fading(model: MotionModel, modes: Modes | None) -> float:
    """Smallest rate (1/s) at which a servo or a mode comes to rest."""
    rates = [] if modes is None else (modes.omega * modes.damping).tolist()
    for effect in model.effects:
        if isinstance(effect, ServoResponse):
            omega, ratio = 2.0 * np.pi * model.values[effect.keys[0]], model.values[effect.keys[1]]
            rates.append(omega * (ratio - np.sqrt(max(ratio**2 - 1.0, 0.0))))
    return float(min(rates))


def _moved(model: MotionModel, paths: Array, start: Array, step: float) -> Array:
    """(M + 1, B, n), angles (rad) at which the servos of all joints are, commanded along paths (B, M, n).

    Joints with the same effects are simulated at once. The loads are those along the mean of the paths.
    """
    many, length, dof = paths.shape
    loads = joint_loads(model.arm, np.concatenate([start[None], paths.mean(axis=0)])[None], step)
    reference, out = reference_inertia(model.arm), np.empty((length + 1, many, dof))
    alike: dict[tuple[type[MotionEffect], ...], list[int]] = defaultdict(list)
    for joint in range(model.arm.dof):
        alike[tuple(type(effect) for effect in _led(model, joint))].append(joint)
    for joints in alike.values():
        command, gravity, reaction, inertia = (
            np.moveaxis(np.broadcast_to(x[:, -length:, joints], (many, length, len(joints))), 0, 1).reshape(length, -1)
            for x in (paths, loads.gravity, loads.reaction, loads.inertia)
        )
        effects = [_led(model, joint) for joint in joints]
        values = [
            [
                np.array([[model.values[of_joint[i].keys[k]] for of_joint in effects] * many])
                for k in range(len(effect.keys))
            ]
            for i, effect in enumerate(effects[0])
        ]
        at_rest = np.tile(start[joints], many)
        drive = JointDrive(
            step, command, gravity, reaction, inertia, np.tile(reference[joints], many), at_rest, np.zeros(len(at_rest))
        )
        out[:, :, joints] = simulate(effects[0], values, drive)[:, 0].reshape(length + 1, many, -1)
    return out


def _led(model: MotionModel, joint: int) -> tuple[MotionEffect, ...]:
    """Effects between a joint's command and its servo's angle."""
    return tuple(effect for effect in model.of_joint(joint) if not isinstance(effect, Swing))


def tip_jacobian(model: MotionModel, q: Array) -> Array:
    """(n, 3), m of the tip for each rad of a joint at a posture."""
    chain = chain_of(model.arm)
    geometry = chain_geometry(chain, chain.values([np.array([angle]) for angle in q.tolist()]), 1)
    slots = list(chain.joint_slots)
    axis, origin = geometry.axis[slots, :, 0], geometry.origin[slots, :, 0]
    return np.asarray(np.cross(axis, geometry.tcp[:, 0] - origin))
