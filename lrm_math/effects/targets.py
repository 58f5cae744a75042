"""Targets of effects: what a target's name says that amounts are added to.

| name | amount |
|---|---|
| `joint2.theta`, `link1.x`, `base.alpha`, `joint3.d` … | motion of a slot of the chain: rad, m |
| `joint2.servo` | the same as `joint2.theta`, before the joint's encoder, which reads it |
| `joint2.theta.load` | load on a slot: N·m, N; no function of loads itself |
| `body3.mass`, `body3.com_x` … | mass (kg) and centre of mass (m) of a body, by its number from 0 outwards |
| `frame.xx`, `frame.xyz`, `frame.xr` … | coefficient of x, of y z (1/m), of x (x² + y² + z²) (1/m²) in the seen x |
| `frame.x` … | shift of the seen x: m |
| `frame.s` | what a measured position is multiplied by, less one |
| `gravity.x` … | component of gravity in the frame of measurement: m/s² |
| `anchor.x` … | the fixed point that distances are measured from: m |
"""

from __future__ import annotations

from enum import Enum

from lrm_math.effects.base import Effect
from lrm_math.errors import LrmError

SERVO, LOAD, BODY, GRAVITY, FRAME, ANCHOR = ".servo", ".load", "body", "gravity.", "frame.", "anchor."
BODY_AMOUNTS = ("mass", "com_x", "com_y", "com_z")
FRAME_PLACE = FRAME.rstrip(".")
RADIAL, SCALE = "r", "s"
"""Term of a position by its own length squared; target of a scale of all three components alike."""


class Kind(Enum):
    """Kind of all targets of one effect."""

    MOTION = "motions of slots"
    LOAD = "loads on slots"
    WEIGHT = "weights of bodies"
    GRAVITY = "the direction of gravity"
    FRAME = "the frame of measurement"
    ANCHOR = "the fixed point of measured distances"


def kind_of(effect: Effect) -> Kind:
    """The kind of an effect's targets. Raises `LrmError` if they are of several kinds: those are several effects."""
    kinds = {_kind(target) for target in effect.targets}
    if len(kinds) != 1:
        several = " and ".join(sorted(kind.value for kind in kinds)) or "nothing"
        raise LrmError(f"effect {effect.name} acts on {several}; the targets of one effect should be of one kind")
    return kinds.pop()


def _kind(target: str) -> Kind:
    if target.startswith(FRAME):
        return Kind.FRAME
    if target.startswith(ANCHOR):
        return Kind.ANCHOR
    if target.startswith(GRAVITY):
        return Kind.GRAVITY
    if target.startswith(BODY):
        return Kind.WEIGHT
    return Kind.LOAD if target.endswith(LOAD) else Kind.MOTION


def slot_of(target: str) -> str:
    """The key of the slot that a motion or a load acts on."""
    return target.removesuffix(SERVO) + ".theta" if target.endswith(SERVO) else target.removesuffix(LOAD)


def links_bent_at_ends(effect: Effect) -> frozenset[str]:
    """Links (`linkN`) of which it turns an end, `linkN.near_x` for instance, beside their middle."""
    turned = (target.split(".") for target in effect.targets if target.startswith("link"))
    return frozenset(place for place, name in turned if name.startswith(("near_", "far_")))
