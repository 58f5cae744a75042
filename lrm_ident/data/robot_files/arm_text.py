"""Text of arm files: of an imported arm, and a template with comments to fill in."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from lrm_math.arm.arm import Arm, Placement
from lrm_math.arm.arm_file import ARM_SCHEMA, GRAM, MM
from lrm_math.arrays import Array
from lrm_math.errors import LrmError

ORDER = "Link i: Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta) Tz(extra z). Base: T(x, y, z) Rx Ry Rz. Tool: Rx Ry Rz T."
IN_UNIT: dict[str, Callable[[Array], Array]] = {
    "mm": lambda lengths: lengths / MM,
    "g": lambda masses: masses / GRAM,
    "deg": np.degrees,
    "s2": np.array,
}


def arm_text(arm: Arm, source: str, comments: Sequence[str] = ()) -> str:
    """Text of an arm's file, exact to round-off, without servo tables and collision shapes.

    Raises `LrmError` for an arm that has some: they would be lost.
    """
    if arm.shapes.capsules or arm.shapes.boxes or arm.auxiliary_servos or any(joint.servo for joint in arm.joints):
        raise LrmError(f"{arm.name} has servo tables or collision shapes, which this writer does not know")
    return "\n".join(_lines(arm, source, comments)) + "\n"


def _lines(arm: Arm, source: str, comments: Sequence[str]) -> Iterator[str]:
    yield from (f"# {comment}" for comment in (*comments, ORDER))
    yield from _keys(schema=ARM_SCHEMA, name=arm.name, source=source, accepted=list(arm.accepted) or None)
    yield from _keys(gravity_m_per_s2=arm.gravity, table_z_mm=arm.table)
    yield from ("", "[base]", *_placement(arm.base))
    for _, joint, mimic in arm.chain_order:
        yield from ("", "[[joint]]", *_keys(name=joint.name or None, theta_deg=joint.theta, d_mm=joint.d, a_mm=joint.a))
        yield from _keys(alpha_deg=joint.alpha, beta_deg=joint.beta or None, extra_z_mm=joint.extra_z)
        yield from _keys(limits_deg=(joint.lower, joint.upper))
        if mimic is not None:
            told = _keys(joint=f"joint{mimic.leader + 1}", ratio=mimic.ratio, offset_deg=mimic.offset or None)
            yield f"follow = {{{', '.join(told)}}}"
    yield from ("", "[tool]", *_placement(arm.tool))
    for body in arm.bodies:
        yield from ("", "[[body]]", *_keys(name=body.name, mass_g=body.mass, com_mm=body.com))
        yield from _keys(com_from="near_end" if body.near_end else None, frame=arm.frame_names[body.frame])
        yield from _keys(loads_joint=body.loads_joint, carries_payload=body.carries_payload or None)


def _placement(p: Placement) -> Iterator[str]:
    yield from _keys(x_mm=p.x, y_mm=p.y, z_mm=p.z, alpha_deg=p.alpha, beta_deg=p.beta, gamma_deg=p.gamma)


def _keys(**values: str | float | tuple[float, ...] | list[str] | None) -> Iterator[str]:
    """Lines of TOML, of keys that have a value (SI), in the unit that ends their names."""
    for key, value in values.items():
        if value is not None:
            in_unit = IN_UNIT.get(key.rpartition("_")[2])
            yield f"{key} = {json.dumps(value if in_unit is None else (in_unit(np.array(value)) + 0.0).tolist())}"


def template(name: str) -> str:
    """Text of a commented arm file of one's own, valid as it stands: an upright arm of six joints."""
    text = Path(__file__).with_name("template.toml").read_text(encoding="utf-8")
    return text.replace('"my-arm"', json.dumps(name))
