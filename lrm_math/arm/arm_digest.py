"""SHA-256 of what an arm is: its links, tool and masses; not how it stands, how far it may turn, or its names."""

from __future__ import annotations

import hashlib
import json
from dataclasses import astuple

from lrm_math.arm.arm import Arm, Joint

DECIMALS = 12
"""Of metres, radians and kilograms: files of one arm agree to more, different arms to less."""
WHAT_COUNTS = "links, tool or masses"


def arm_sha256(arm: Arm) -> str:
    """Digest of the links (zeros included), the tool and the bodies, by which arms of one name are told apart.

    Base, gravity, limits, servo tables and shapes may change without making another arm of it.
    """
    links = [_dimensions(joint) for joint in arm.joints]
    bodies = sorted(
        (_rounded((body.mass, *body.com)), body.frame, body.loads_joint, body.near_end, body.carries_payload)
        for body in arm.bodies
    )
    content = [[_rounded(link) for link in links], _rounded(astuple(arm.tool)), bodies]
    for mimic in arm.mimics:
        content.append([mimic.after, mimic.leader, _rounded((mimic.ratio, mimic.offset, *_dimensions(mimic.link)))])
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def _dimensions(joint: Joint) -> tuple[float | None, ...]:
    return joint.theta, joint.d, joint.a, joint.alpha, joint.beta, joint.extra_z


def _rounded(values: tuple[float | None, ...]) -> list[float | None]:
    return [None if value is None else round(value, DECIMALS) + 0.0 for value in values]
