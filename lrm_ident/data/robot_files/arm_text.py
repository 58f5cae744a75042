"""Text of arm files: of an imported arm, and a template with comments to fill in."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence

import numpy as np

from lrm_math.arm.arm import Arm, Body, Joint, Placement
from lrm_math.arm.arm_file import ARM_SCHEMA, GRAM, MM
from lrm_math.errors import LrmError

ORDER = "Link i: Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta) Tz(extra z). Base: T(x, y, z) Rx Ry Rz. Tool: Rx Ry Rz T."


def arm_text(arm: Arm, source: str, comments: Sequence[str] = ()) -> str:
    """Text of an arm's file, exact to round-off, without servo tables and collision shapes.

    Raises `LrmError` for an arm that has some: they would be lost.
    """
    if arm.shapes.capsules or arm.shapes.boxes or arm.auxiliary_servos or any(joint.servo for joint in arm.joints):
        raise LrmError(f"{arm.name} has servo tables or collision shapes, which this writer does not know")
    return "\n".join(_lines(arm, source, comments)) + "\n"


def _lines(arm: Arm, source: str, comments: Sequence[str]) -> Iterator[str]:
    yield from (f"# {comment}" for comment in (*comments, ORDER))
    yield f'schema = "{ARM_SCHEMA}"'
    yield f"name = {json.dumps(arm.name)}"
    yield f"source = {json.dumps(source)}"
    yield f"gravity_m_per_s2 = {_list(arm.gravity, 1.0)}"
    yield from ("", "[base]", *_placement(arm.base))
    for joint in arm.joints:
        yield from ("", "[[joint]]", *_joint(joint))
    yield from ("", "[tool]", *_placement(arm.tool))
    for body in arm.bodies:
        yield from ("", "[[body]]", *_body(body, arm.dof))


def _placement(p: Placement) -> Iterator[str]:
    yield from (f"{name}_mm = {_number(getattr(p, name), MM)}" for name in ("x", "y", "z"))
    yield from (f"{name}_deg = {_degrees(getattr(p, name))}" for name in ("alpha", "beta", "gamma"))


def _joint(joint: Joint) -> Iterator[str]:
    if joint.name:
        yield f"name = {json.dumps(joint.name)}"
    yield f"theta_deg = {_degrees(joint.theta)}"
    yield f"d_mm = {_number(joint.d, MM)}"
    yield f"a_mm = {_number(joint.a, MM)}"
    yield f"alpha_deg = {_degrees(joint.alpha)}"
    if joint.beta:
        yield f"beta_deg = {_degrees(joint.beta)}"
    if joint.extra_z is not None:
        yield f"extra_z_mm = {_number(joint.extra_z, MM)}"
    yield f"limits_deg = [{_degrees(joint.lower)}, {_degrees(joint.upper)}]"


def _body(body: Body, dof: int) -> Iterator[str]:
    frames = ["base", *(f"joint{i}" for i in range(1, dof + 1)), "tool"]
    yield f"name = {json.dumps(body.name)}"
    yield f"mass_g = {_number(body.mass, GRAM)}"
    yield f"com_mm = {_list(body.com, MM)}"
    if body.near_end:
        yield 'com_from = "near_end"'
    yield f'frame = "{frames[body.frame]}"'
    yield f"loads_joint = {body.loads_joint}"
    if body.carries_payload:
        yield "carries_payload = true"


def _number(value: float, unit: float) -> str:
    return repr(float(value / unit) + 0.0)


def _degrees(angle: float) -> str:
    return repr(float(np.degrees(angle)) + 0.0)


def _list(values: Sequence[float], unit: float) -> str:
    return f"[{', '.join(_number(value, unit) for value in values)}]"


def template(name: str) -> str:
    """Text of a commented arm file of one's own, valid as it stands: an upright arm of six joints."""
    return "\n".join([*_TEMPLATE_HEAD, *_template_joints(), *_TEMPLATE_TAIL]).replace("NAME", json.dumps(name)) + "\n"


_TEMPLATE_HEAD = (
    "# An arm of your own. Lengths in mm, angles in deg, masses in g. Is there a URDF? Then rather:",
    "#   lrm-ident arm import robot.urdf -o arm.toml",
    "# Check it with: lrm-ident arm show THIS_FILE",
    f'schema = "{ARM_SCHEMA}"',
    "name = NAME",
    'source = "measured with a ruler"   # where the numbers are from',
    "gravity_m_per_s2 = [0.0, 0.0, -9.81]   # in the frame of the measured positions; here their z points up",
    "",
    "# Where joint 1 stands in the frame of the measured positions: T(x, y, z), then turns about x, y, z. z is axis 1.",
    "[base]",
    "x_mm = 0.0",
    "y_mm = 0.0",
    "z_mm = 50.0",
    "alpha_deg = 0.0",
    "beta_deg = 0.0",
    "gamma_deg = 0.0",
    "",
    "# Modified Denavit–Hartenberg: Rz(theta + q) Tz(d) Tx(a) Rx(alpha) leads from one joint's axis to the next.",
    "# The number of [[joint]] tables is the number of joints, 1 to 10. q = 0 is what your controller calls zero;",
    "# theta is where the model's zero is from there. limits_deg: the angles that the joint can be sent to.",
)
_LINKS = ((0, 60, 0, -90, "waist"), (-90, 0, 120, 0, "shoulder"), (90, 0, 0, 90, "elbow"), (0, 110, 0, -90, "roll"),
          (0, 0, 0, 90, "pitch"), (0, 60, 0, 0, "wrist"))  # fmt: skip
_TEMPLATE_TAIL = (
    "",
    "# From the end of the last link to the TCP, the point that is measured: turns about x, y, z, then T(x, y, z).",
    "[tool]",
    "x_mm = 0.0",
    "y_mm = 0.0",
    "z_mm = 40.0",
    "alpha_deg = 0.0",
    "beta_deg = 0.0",
    "gamma_deg = 0.0",
    "",
    "# What is heavy: weigh the parts. com_mm: centre of mass in the frame at the far end of the link of `frame`.",
    "# loads_joint: the first joint that carries it, most often the number in `frame`.",
    "[[body]]",
    'name = "upper arm"',
    "mass_g = 120.0",
    "com_mm = [-60.0, 0.0, 0.0]",
    'frame = "joint2"',
    "loads_joint = 2",
    "",
    "[[body]]",
    'name = "forearm"',
    "mass_g = 100.0",
    "com_mm = [0.0, 50.0, 0.0]",
    'frame = "joint4"',
    "loads_joint = 4",
    "",
    "[[body]]",
    'name = "hand"',
    "mass_g = 80.0",
    "com_mm = [0.0, 0.0, 0.0]",
    'frame = "joint6"',
    "loads_joint = 6",
    "",
    "# Where a load (payload_g of the measurements) hangs.",
    "[[body]]",
    'name = "load"',
    "mass_g = 0.0",
    "com_mm = [0.0, 0.0, 0.0]",
    'frame = "tool"',
    "loads_joint = 6",
    "carries_payload = true",
)


def _template_joints() -> Iterator[str]:
    for number, (theta, d, a, alpha, name) in enumerate(_LINKS, start=1):
        yield from ("", f"[[joint]]   # {number}", f'name = "{name}"', f"theta_deg = {theta}.0", f"d_mm = {d}.0")
        yield from (f"a_mm = {a}.0", f"alpha_deg = {alpha}.0", "limits_deg = [-90.0, 90.0]")
