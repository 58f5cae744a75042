"""Report of an arm: dimensions, masses, reach, gravity's torques."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lrm_ident.report.document import Block, Document, ResultTable
from lrm_math.arm.arm import Arm, Joint, MimicJoint
from lrm_math.arm.arm_file import GRAM, MM
from lrm_math.arm.plausible_arm import total_mass
from lrm_math.arrays import Array
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

DIMENSIONS = "theta_deg|.3f", "d_mm|.3f", "a_mm|.3f", "alpha_deg|.3f", "beta_deg|.4f", "extra_z_mm|.3f"


def arm_document(arm: Arm, difference: float | None = None, q: Array | None = None) -> Document:
    """Result of `lrm-ident arm show` and `arm import`, schema `lrm/arm-report/1`.

    Args:
        difference: largest difference from the URDF's own kinematics (m, rad), of an imported arm.
        q: (n,), joint angles (rad) at which torques are shown; None: zero.
    """
    angles = np.zeros(arm.dof) if q is None else q
    settled = solve_equilibrium(model_of(arm, ()), poses_of(angles))
    torque, tcp = settled.joint_torque[0], settled.tcp[0] / MM
    at = "at zero" if not angles.any() else "at " + ", ".join(f"{angle:g}°" for angle in np.degrees(angles))
    joints = ResultTable(
        ("joint", "name", "lower_deg|.1f", "upper_deg|.1f", "torque_Nm|.3f"),
        [_joint_row(*entry, torque) for entry in arm.chain_order],
        f"{arm.name}: {arm.dof} joints; gravity's torque on each {at}",
    )
    links = ResultTable(("link", *DIMENSIONS), [_link_row(arm, i) for i in range(len(arm.links))])
    frames = arm.frame_names
    bodies = ResultTable(
        ("body", "mass_g|.1f", "com_x_mm|.2f", "com_y_mm|.2f", "com_z_mm|.2f", "frame", "loads joint|d"),
        [(b.name, b.mass / GRAM, *(c / MM for c in b.com), frames[b.frame], b.loads_joint) for b in arm.bodies],
    )
    x, y, z = tcp.tolist()
    blocks: list[Block] = [joints, *_lines(arm, f"{at}: {x:.2f}, {y:.2f}, {z:.2f}", difference)]
    values = {
        "arm": arm.name,
        "joints": joints.records(),
        "links": links.records(),
        "bodies": bodies.records(),
        "tcp_mm": tcp,
        "longest_mm": chain_of(arm).length / MM,
        "moving_mass_g": total_mass(arm) / GRAM,
        "largest_difference": difference,
    }
    return Document(blocks, "lrm/arm-report/1", values, links, [links, bodies], "dimensions of the links, masses")


def _lines(arm: Arm, tcp: str, difference: float | None) -> Iterator[str]:
    """Sentences that the tables do not say; `tcp`: where the TCP is, in mm."""
    mass = total_mass(arm)
    yield (
        f"TCP {tcp} mm. From joint 1 it reaches {chain_of(arm).length / MM:.0f} mm at most. "
        f"Moving: {mass / GRAM:.0f} g."
    )
    words = [place.removeprefix("joint") for place in arm.link_places]
    pairs = zip(words, words[1:], arm.links, strict=False)
    parallel = [f"{joint} and {other}" for joint, other, link in pairs if link.leads_parallel]
    if parallel:
        yield f"(Nearly) parallel axes: {'; '.join(parallel)}."
    if not mass:
        yield "No mass: the model will not sag under the arm's own weight. State mass_g and com_mm of its bodies."
    if difference is not None:
        yield f"Largest difference from the URDF's own kinematics at random poses: {difference:.1g} (m, rad)."


def _joint_row(place: str, link: Joint, mimic: MimicJoint | None, torque: Array) -> tuple[object, ...]:
    """A joint with its torque (n,), N·m; of one without a motor what it follows, whose torque includes its own."""
    if mimic is None:
        limits = np.degrees([link.lower, link.upper]).tolist()
        number = place.removeprefix("joint")
        return number, link.name, *limits, float(torque[int(number) - 1])
    offset = math.degrees(mimic.offset)
    turned = f" {offset:+.4g}°" if mimic.offset else ""
    named = f"{link.name}: " if link.name else ""
    return place, f"{named}{mimic.ratio:g} × joint {mimic.leader + 1}{turned}", None, None, None


def _link_row(arm: Arm, i: int) -> tuple[object, ...]:
    joint = arm.links[i]
    theta, alpha, beta = np.degrees([joint.theta, joint.alpha, joint.beta]).tolist()
    extra = None if joint.extra_z is None else joint.extra_z / MM
    return str(i + 1), theta, joint.d / MM, joint.a / MM, alpha, beta if joint.beta else None, extra
