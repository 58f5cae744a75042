"""An arm close to the calibrated one that may have a closed form: seeds for Newton's method."""

from __future__ import annotations

from dataclasses import replace

from lrm_math.arm.arm import BASE, TOOL, Arm, Joint, Placement
from lrm_math.model.model import Model


def equivalent_arm(model: Model) -> Arm:
    """The arm with corrected angles and corrected nonzero lengths; further lengths would separate its axes."""
    amounts = dict(zip((slot.key for slot in model.chain.slots), model.binding.constants, strict=True))

    def placed(place: str) -> Placement:
        return Placement(*(amounts[f"{place}.{name}"] for name in ("x", "y", "z", "alpha", "beta", "gamma")))

    def length(key: str, drawn: float | None) -> float | None:
        return amounts[key] if drawn else drawn

    def joint(place: str, drawn: Joint) -> Joint:
        d, a, extra_z = (length(f"{place}.{name}", getattr(drawn, name)) for name in ("d", "a", "extra_z"))
        turned = replace(drawn, theta=amounts[f"{place}.theta"], alpha=amounts[f"{place}.alpha"], beta=0.0)
        return replace(turned, d=d or 0.0, a=a or 0.0, extra_z=extra_z)

    joints = tuple(joint(f"joint{i}", drawn) for i, drawn in enumerate(model.arm.joints, 1))
    return replace(model.arm, base=placed(BASE), joints=joints, tool=placed(TOOL))
