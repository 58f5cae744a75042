"""Weights of a robot's own MJCF as a model has them, without which its springs would bend otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate

import numpy as np

from lrm_ident.data.robot_files.mjcf import slot_motions
from lrm_ident.data.robot_files.mjcf_robot import MjcfRobot
from lrm_ident.data.robot_files.rigid_motion import inverse
from lrm_ident.data.robot_files.urdf import Urdf, UrdfJoint
from lrm_math.arrays import Array
from lrm_math.model.model import Model

SAME = 1e-9
"""kg, kg·m."""


def places_at_zero(model: Model) -> list[Array]:
    """(4, 4) each, the frame of every slot of a model's chain, and of its end, the arm at zero."""
    return list(accumulate(slot_motions(model), np.matmul, initial=np.eye(4)))


def joints_before(model: Model, k: int) -> int:
    """Number of joints before slot k of a model's chain."""
    return sum(slot.joint is not None for slot in model.chain.slots[:k])


def bends_own_weight(model: Model, k: int) -> bool:
    """Whether slot k of a model's chain moves a body that the last joint before it carries itself."""
    number = joints_before(model, k)
    return number > 0 and any(
        body.before > k and joints_before(model, body.before) == number for body in model.chain.bodies
    )


def carriers_of(path: Sequence[UrdfJoint]) -> list[Array]:
    """(4, 4) each, frames of the links that joints 1 … n of a path carry, the arm at zero."""
    out, pose = [], np.eye(4)
    for joint in path:
        pose = pose @ joint.origin
        if joint.turns:
            out.append(pose)
    return out


def weigh(model: Model, own: MjcfRobot, robot: Urdf, path: Sequence[UrdfJoint]) -> Iterator[str]:
    """Gives what each joint carries the model's mass and centre of mass, by its heaviest part; yields what cannot be.

    `robot`: the corrected one. `path`: its joints from base to tip.
    """
    moments, links = _moments(model), [joint.child for joint in path if joint.turns]
    onward = [*links[1:], ""]
    for number, (link, stands, without) in enumerate(zip(links, carriers_of(path), onward, strict=True), start=1):
        parts = [(name, where, robot.links[name]) for name, where in robot.carried_by(link, without)]
        heavy = [(name, where, mass) for name, where, mass in parts if mass is not None and own.is_body(name)]
        has = sum((mass.mass * (where @ np.array([*mass.com, 1.0])) for _, where, mass in heavy), np.zeros(4))
        lacks = inverse(stands) @ moments[number] - has
        if np.abs(lacks).max() < SAME:
            continue
        name, where, mass = max(heavy, key=lambda part: part[2].mass, default=(link, np.eye(4), None))
        moment = inverse(where) @ lacks + (0.0 if mass is None else mass.mass * np.array([*mass.com, 1.0]))
        if moment[3] <= 0.0:
            yield f"the weight of {name}"
        else:
            _set_mass(own, name, moment)


def _moments(model: Model) -> dict[int, Array]:
    """First mass moment (kg m) and mass (kg) (4,) of what each joint carries up to the next, the arm at zero."""
    places = places_at_zero(model)
    out = {number: np.zeros(4) for number in range(model.arm.dof + 1)}
    for body, weight in zip(model.chain.bodies, model.weights(0.0), strict=True):
        moment = places[body.before] @ np.array([*map(float, weight.com), 1.0])
        out[joints_before(model, body.before)] += float(weight.mass) * moment
    return out


def _set_mass(own: MjcfRobot, link: str, moment: Array) -> None:
    number, body = own.body(link), own.spec_body(link)
    compiled = own.compiled
    body.mass, body.ipos = float(moment[3]), moment[:3] / moment[3] + own.anchor(number)[:3, 3]
    body.inertia, body.iquat = compiled.body_inertia[number], compiled.body_iquat[number]
    body.fullinertia, body.ialt.type, body.explicitinertial = np.full(6, np.nan), 0, True
