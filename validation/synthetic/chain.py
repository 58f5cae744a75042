"""Forward kinematics of the true arm: the product of exponentials formula (Brockett 1984)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .arm_description import ArmDescription, BodyDescription, FramePlacement, LinkDescription
from .ground_truth import ZERO, GroundTruth
from .screws import (
    WORLD,
    Array,
    CoordinateFrame,
    RigidMotion,
    displacement,
    exponential,
    revolute_twist,
    rotation_matrix,
)

X, Y, Z = 0, 1, 2


@dataclass(frozen=True)
class TrueChain:
    """Zero configuration in world axes, m: unit axis (3,) of the base's compliance through the base's origin, N joint
    axes (unit (3,), point (3,)), link end frames 0..N (0: the base), B bodies with the axes (B, 3, 3) of the frames of
    their `com_m`, centres of mass (B, 3) or (B, P, 3), TCP (3,), axes of the tool (3, 3)."""

    base_axis: Array
    joint_axes: tuple[Array, ...]
    joint_points: tuple[Array, ...]
    ends: tuple[CoordinateFrame, ...]
    bodies: tuple[BodyDescription, ...]
    body_axes: Array
    centres: Array
    tcp: Array
    tool_axes: Array


@dataclass(frozen=True)
class Posture:
    """P postures in world axes, m: tcp (P, 3), tool axes (P, 3, 3), centres of mass (P, B, 3), joint axes and points
    (P, N, 3), base axis and point (P, 3), and for each flexible link the undeflected end axes (P, 3, 3) and deflected
    end point (P, 3)."""

    tcp: Array
    centres: Array
    base_axis: Array
    base_point: Array
    joint_axes: Array
    joint_points: Array
    end_axes: Mapping[int, Array]
    end_points: Mapping[int, Array]
    tool_axes: Array


def zero_configuration(arm: ArmDescription, truth: GroundTruth) -> TrueChain:
    """The chain at zero joint angles, deviations and displacements included."""
    errors, (base_error, *link_errors, tool_error) = truth.deviations, truth.displacements
    base, base_axis = _at_base(WORLD, arm.base, errors.base)
    frame = base.displaced(base_error)
    proximal, distal = [frame], [frame]
    for link, error, displaced in zip(arm.links, errors.links, link_errors, strict=True):
        near, frame = _along_link(frame.displaced(displaced), link, error)
        proximal.append(near)
        distal.append(frame)
    near, tip = _at_tool(frame.displaced(tool_error), arm.tool, errors.tool)
    frames = [([*proximal, near] if body.near_end else [*distal, tip])[body.frame] for body in arm.bodies]
    return TrueChain(
        base_axis=rotation_matrix(base_error[:3]) @ base_axis,
        joint_axes=tuple(end.axes[:, Z] for end in distal[:-1]),
        joint_points=tuple(end.origin for end in distal[:-1]),
        ends=tuple(distal),
        bodies=arm.bodies,
        body_axes=np.array([frame.axes for frame in frames]),
        centres=np.array([frame.to_world(body.com_m) for frame, body in zip(frames, arm.bodies, strict=True)]),
        tcp=tip.origin,
        tool_axes=tip.axes,
    )


def _at_base(frame: CoordinateFrame, base: FramePlacement, error: Sequence[float]) -> tuple[CoordinateFrame, Array]:
    """The base's frame, and its y axis before the rotation by gamma, about which beta rotates."""
    for axis in (X, Y, Z):
        frame = frame.translated(axis, base.xyz_m[axis] + error[axis])
    for axis in (X, Y):
        frame = frame.rotated(axis, base.angles_rad[axis] + error[3 + axis])
    return frame.rotated(Z, base.angles_rad[Z] + error[3 + Z]), frame.axes[:, Y]


def base_displacement_to_deviations(arm: ArmDescription, truth: GroundTruth) -> GroundTruth:
    """The same rigid arm with the displacement of its base expressed as deviations of the base's six dimensions.

    Only the axis of the base's compliance changes: a displacement moves it too; with deviations it is that of the
    published model, Rx(alpha) y of the base.
    """
    frame = _at_base(WORLD, arm.base, truth.deviations.base)[0].displaced(truth.displacements[0])
    R = frame.axes
    angles = np.arctan2([-R[1, 2], R[0, 2], -R[0, 1]], [R[2, 2], math.hypot(R[0, 0], R[0, 1]), R[0, 0]])
    x, y, z = (frame.origin - arm.base.xyz_m).tolist()
    alpha, beta, gamma = (angles - arm.base.angles_rad).tolist()
    deviations = replace(truth.deviations, base=(x, y, z, alpha, beta, gamma))
    return replace(truth, deviations=deviations, displacements=(ZERO, *truth.displacements[1:]))


def _along_link(
    frame: CoordinateFrame, link: LinkDescription, error: Sequence[float]
) -> tuple[CoordinateFrame, CoordinateFrame]:
    """The link's frame before its last translation along z, and its end frame."""
    frame = frame.rotated(Z, link.theta_rad + error[0]).translated(Z, link.d_m + error[1])
    near = frame.translated(X, link.a_m + error[2]).rotated(X, link.alpha_rad + error[3]).rotated(Y, link.beta_rad)
    return near, near.translated(Z, link.extra_z_m + error[4])


def _at_tool(
    frame: CoordinateFrame, tool: FramePlacement, error: Sequence[float]
) -> tuple[CoordinateFrame, CoordinateFrame]:
    for axis in (X, Y, Z):
        frame = frame.rotated(axis, tool.angles_rad[axis] + error[3 + axis])
    for axis in (X, Y):
        frame = frame.translated(axis, tool.xyz_m[axis] + error[axis])
    return frame, frame.translated(Z, tool.xyz_m[Z] + error[Z])


def forward_kinematics(chain: TrueChain, base_rad: Array, q_rad: Array, deflections: Mapping[int, Array]) -> Posture:
    """Posture from base deflection (P,), joint angles (P, N), and the deflections (P, 6) of the flexible links' ends:
    rotation vector in rad and displacement in m, in the axes of the end frame."""
    base = chain.ends[0]
    rigid = [exponential(revolute_twist(chain.base_axis, base.origin), base_rad)]
    flexed = [_deflect(rigid[0], base, deflections.get(0))]
    for number, (axis, point) in enumerate(zip(chain.joint_axes, chain.joint_points, strict=True), start=1):
        rigid.append(flexed[-1] @ exponential(revolute_twist(axis, point), q_rad[:, number - 1]))
        flexed.append(_deflect(rigid[-1], chain.ends[number], deflections.get(number)))
    centres = [
        _carrier(body, rigid, flexed).point(centre) for body, centre in zip(chain.bodies, chain.centres, strict=True)
    ]
    return Posture(
        tcp=flexed[-1].point(chain.tcp),
        centres=np.stack(centres, axis=1),
        base_axis=rigid[0].vector(chain.base_axis),
        base_point=rigid[0].point(base.origin),
        joint_axes=np.stack([m.vector(a) for m, a in zip(flexed[:-1], chain.joint_axes, strict=True)], axis=1),
        joint_points=np.stack([m.point(p) for m, p in zip(flexed[:-1], chain.joint_points, strict=True)], axis=1),
        end_axes={link: rigid[link].rotation @ chain.ends[link].axes for link in deflections},
        end_points={link: flexed[link].point(chain.ends[link].origin) for link in deflections},
        tool_axes=flexed[-1].rotation @ chain.tool_axes,
    )


def _deflect(rigid: RigidMotion, end: CoordinateFrame, deflection: Array | None) -> RigidMotion:
    if deflection is None:
        return rigid
    return rigid @ displacement(end.origin, deflection[:, :3] @ end.axes.T, deflection[:, 3:] @ end.axes.T)


def _carrier(body: BodyDescription, rigid: list[RigidMotion], flexed: list[RigidMotion]) -> RigidMotion:
    """A link's own mass does not follow the deflection of its distal end; what the link carries does."""
    if body.frame >= len(flexed):
        return flexed[-1]
    return flexed[body.frame] if body.loads_joint > body.frame else rigid[body.frame]


def is_carried_by(body: BodyDescription, link: int) -> bool:
    """Whether the body loads the distal end of that link (0: the base)."""
    return max(body.frame, body.loads_joint) > link
