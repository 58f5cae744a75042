"""Text of arm files: of an imported arm, and a template with comments to fill in."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

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
    text = Path(__file__).with_name("template.toml").read_text(encoding="utf-8")
    return text.replace('"my-arm"', json.dumps(name))
