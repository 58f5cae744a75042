"""How long an arm swings after a move: the time until the tip stays near where it comes to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.motion.base import JointDrive
from lrm_math.motion.loads import joint_loads, reference_inertia
from lrm_math.motion.motion_model import MotionModel
from lrm_math.motion.simulation import simulate

STEP_S, LONGEST_S = 0.005, 8.0
"""s: of the simulation, and how long after its end a move is followed."""


@dataclass(frozen=True)
class Settling:
    """Time (s) from the end of a commanded move until the tip stays within a distance; the joint (from 0) that moves
    the tip most at the last."""

    seconds: float
    joint: int


def settling(model: MotionModel, start: Array, goal: Array, speed: float, within: float) -> Settling:
    """Of a straight move in joint space at a speed (rad/s of the fastest joint) from `start` to `goal` (n,), rad.

    `within`: m. The joints' deviations from their rest are added as if they all moved the tip the same way, a bound.
    """
    ramp = max(int(np.ceil(np.abs(goal - start).max() / speed / STEP_S)), 1)
    share = np.minimum(np.arange(1, ramp + round(LONGEST_S / STEP_S) + 1) / ramp, 1.0)
    path = start + share[:, None] * (goal - start)
    moved = _moved(model, path, start)
    away = np.abs(moved - moved[-1]) * _levers(model, goal)
    far = np.flatnonzero(away[ramp:].sum(axis=1) > within)
    last = int(far[-1]) if len(far) else 0
    seconds = (last + 1) * STEP_S if len(far) else 0.0
    return Settling(seconds, int(np.argmax(away[ramp + last])))


def _moved(model: MotionModel, path: Array, start: Array) -> Array:
    """(M + 1, n), angles (rad) of all joints that are commanded along a path (M, n), at the steps of the simulation."""
    loads = joint_loads(model.arm, np.concatenate([start[None], path])[None], STEP_S)
    reference, out = reference_inertia(model.arm), []
    for joint in range(model.arm.dof):
        gravity, reaction, inertia = (x[0, 1:, [joint]].T for x in (loads.gravity, loads.reaction, loads.inertia))
        effects = model.of_joint(joint)
        values = [[np.array([[model.values[key]]]) for key in effect.keys] for effect in effects]
        at = start[[joint]]
        drive = JointDrive(
            STEP_S, path[:, [joint]], gravity, reaction, inertia, float(reference[joint]), at, np.zeros(1)
        )
        out.append(simulate(effects, values, drive)[:, 0, 0])
    return np.stack(out, axis=1)


def _levers(model: MotionModel, q: Array) -> Array:
    """(n,), m of the tip for each rad of a joint at a posture."""
    chain = chain_of(model.arm)
    geometry = chain_geometry(chain, chain.values([np.array([angle]) for angle in q.tolist()]), 1)
    slots = list(chain.joint_slots)
    axis, origin = geometry.axis[slots, :, 0], geometry.origin[slots, :, 0]
    return np.asarray(np.linalg.norm(np.cross(axis, geometry.tcp[:, 0] - origin), axis=1))
