"""Kinematics: the zero configuration of the true arm, and its motion as a product of exponentials."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from .rig import Body, Link, Placement, Rig
from .screws import WORLD, Array, Frame, Motion, displacement, exponential, line_twist, rotation
from .truth import NOTHING, Truth

X, Y, Z = 0, 1, 2


@dataclass(frozen=True)
class Chain:
    """Zero configuration in world axes, m: unit axis (3,) about which the base bends at its origin, N joint axes
    (unit (3,), point (3,)), link ends 0..N (0 is the base), B bodies with the axes (B, 3, 3) of the frames that their
    centres are given in, body centres (B, 3) or (B, P, 3), TCP (3,)."""

    base_axis: Array
    joint_axes: tuple[Array, ...]
    joint_points: tuple[Array, ...]
    ends: tuple[Frame, ...]
    bodies: tuple[Body, ...]
    body_axes: Array
    centres: Array
    tcp: Array

    def with_centres_off(self, shifts_m: Array) -> Chain:
        """The same arm whose B bodies have their centres off by (P, B, 3) in m, in their own frames."""
        return replace(self, centres=self.centres[:, None] + np.einsum("bij,pbj->bpi", self.body_axes, shifts_m))


@dataclass(frozen=True)
class Posture:
    """P postures in world axes, m: tcp (P, 3), centres (P, B, 3), joint axes and points (P, N, 3), base axis and point
    (P, 3), and for each link that bends its frame before bending (P, 3, 3) and its end after bending (P, 3)."""

    tcp: Array
    centres: Array
    base_axis: Array
    base_point: Array
    joint_axes: Array
    joint_points: Array
    end_axes: Mapping[int, Array]
    end_points: Mapping[int, Array]


def zero_configuration(rig: Rig, truth: Truth) -> Chain:
    """Walk along the arm at zero joint angles, errors included, and note the screw axes, link ends and bodies."""
    errors, slips = truth.deviations, truth.displacements
    frame, hinge = _at_base(WORLD, rig.base, np.array(errors.base))
    frame, hinge = frame.displaced(slips[0]), rotation(slips[0][:3]) @ hinge
    axes, points, ends, nears = [], [], [frame], [frame]
    for link, error, slip in zip(rig.links, errors.links, slips[1:-1], strict=True):
        axes.append(frame.axes[:, Z])
        points.append(frame.origin)
        near, frame = _along_link(frame.displaced(slip), link, np.array(error))
        nears.append(near)
        ends.append(frame)
    near, tip = _at_tool(frame.displaced(slips[-1]), rig.tool, np.array(errors.tool))
    far = (*ends, tip)
    near_all = (*nears, near)
    stands = [(near_all if body.near_end else far)[body.frame] for body in rig.bodies]
    centres = np.array([stand.place(body.com_m) for stand, body in zip(stands, rig.bodies, strict=True)])
    body_axes = np.array([stand.axes for stand in stands])
    return Chain(hinge, tuple(axes), tuple(points), tuple(ends), rig.bodies, body_axes, centres, tip.origin)


def _at_base(frame: Frame, base: Placement, error: Array) -> tuple[Frame, Array]:
    """The base's frame, and its y axis before the last turn (gamma): a change of beta is a turn about that."""
    for axis in (X, Y, Z):
        frame = frame.moved(axis, base.xyz_m[axis] + error[axis])
    for axis in (X, Y):
        frame = frame.turned(axis, base.angles_rad[axis] + error[3 + axis])
    return frame.turned(Z, base.angles_rad[Z] + error[3 + Z]), frame.axes[:, Y]


def name_base_errors(rig: Rig, truth: Truth) -> Truth:
    """The same rigid arm with the displacement of its base told as deviations of the base's six dimensions.

    Only the axis about which the base bends changes: a displacement carries it along; with deviations it is where the
    published model has it, Rx(alpha) y of the base as it stands.
    """
    frame, _ = _at_base(WORLD, rig.base, np.array(truth.deviations.base))
    frame = frame.displaced(truth.displacements[0])
    R = frame.axes
    angles = np.arctan2([-R[1, 2], R[0, 2], -R[0, 1]], [R[2, 2], math.hypot(R[0, 0], R[0, 1]), R[0, 0]])
    x, y, z = (frame.origin - rig.base.xyz_m).tolist()
    alpha, beta, gamma = (angles - rig.base.angles_rad).tolist()
    deviations = replace(truth.deviations, base=(x, y, z, alpha, beta, gamma))
    return replace(truth, deviations=deviations, displacements=(NOTHING, *truth.displacements[1:]))


def _along_link(frame: Frame, link: Link, error: Array) -> tuple[Frame, Frame]:
    frame = frame.turned(Z, link.theta_rad + error[0]).moved(Z, link.d_m + error[1])
    near = frame.moved(X, link.a_m + error[2]).turned(X, link.alpha_rad + error[3])
    return near, near.moved(Z, link.extra_z_m + error[4])


def _at_tool(frame: Frame, tool: Placement, error: Array) -> tuple[Frame, Frame]:
    for axis in (X, Y, Z):
        frame = frame.turned(axis, tool.angles_rad[axis] + error[3 + axis])
    for axis in (X, Y):
        frame = frame.moved(axis, tool.xyz_m[axis] + error[axis])
    return frame, frame.moved(Z, tool.xyz_m[Z] + error[Z])


def move(chain: Chain, base_rad: Array, q_rad: Array, bends: Mapping[int, Array]) -> Posture:
    """Move the arm: base deflection (P,), joint angles (P, N), and for links that bend the rotation vector and the
    deflection (P, 6) of their end in rad and m, in the axes of the end frame."""
    base = chain.ends[0]
    stiff = [exponential(line_twist(chain.base_axis, base.origin), base_rad)]
    bent = [_bend(stiff[0], base, bends.get(0))]
    for number, (axis, point) in enumerate(zip(chain.joint_axes, chain.joint_points, strict=True), start=1):
        stiff.append(bent[-1] @ exponential(line_twist(axis, point), q_rad[:, number - 1]))
        bent.append(_bend(stiff[-1], chain.ends[number], bends.get(number)))
    centres = [
        _carrier(body, stiff, bent).point(centre) for body, centre in zip(chain.bodies, chain.centres, strict=True)
    ]
    return Posture(
        tcp=bent[-1].point(chain.tcp),
        centres=np.stack(centres, axis=1),
        base_axis=stiff[0].direction(chain.base_axis),
        base_point=stiff[0].point(base.origin),
        joint_axes=np.stack([m.direction(a) for m, a in zip(bent[:-1], chain.joint_axes, strict=True)], axis=1),
        joint_points=np.stack([m.point(p) for m, p in zip(bent[:-1], chain.joint_points, strict=True)], axis=1),
        end_axes={link: stiff[link].turn @ chain.ends[link].axes for link in bends},
        end_points={link: bent[link].point(chain.ends[link].origin) for link in bends},
    )


def _bend(stiff: Motion, end: Frame, bend: Array | None) -> Motion:
    if bend is None:
        return stiff
    return stiff @ displacement(end.origin, bend[:, :3] @ end.axes.T, bend[:, 3:] @ end.axes.T)


def _carrier(body: Body, stiff: list[Motion], bent: list[Motion]) -> Motion:
    """A link's own mass is spread along it and does not follow the bending of its far end; what it carries does."""
    if body.frame >= len(bent):
        return bent[-1]
    return bent[body.frame] if body.loads_joint > body.frame else stiff[body.frame]


def hangs_on(body: Body, link: int) -> bool:
    """Whether the body loads the far end of that link (0: the base)."""
    return max(body.frame, body.loads_joint) > link
