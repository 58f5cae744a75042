"""An arm close to the calibrated one that may have a closed form: seeds for Newton's method."""

from __future__ import annotations

from dataclasses import replace

from lrm_math.arm.arm import BASE, TOOL, Arm, Joint, Placement
from lrm_math.model.model import Model


def equivalent_arm(model: Model) -> Arm:
    """The arm with corrected angles and corrected nonzero lengths; further lengths would separate its axes."""
    amounts = dict(zip((slot.key for slot in model.chain.slots), model.binding.constants, strict=True))

    def placement(place: str) -> Placement:
        """Placement of the base or the tool with the corrected amounts."""
        return Placement(*(amounts[f"{place}.{name}"] for name in ("x", "y", "z", "alpha", "beta", "gamma")))

    def length(place: str, name: str, nominal: float) -> float:
        """Corrected length (m) where the nominal one is not zero."""
        return amounts[f"{place}.{name}"] if nominal else 0.0

    def joint(place: str, nominal_joint: Joint) -> Joint:
        """A joint with its corrected angles and lengths."""
        return replace(
            nominal_joint,
            theta=amounts[f"{place}.theta"],
            d=length(place, "d", nominal_joint.d),
            a=length(place, "a", nominal_joint.a),
            alpha=amounts[f"{place}.alpha"],
            beta=0.0,
            extra_z=None if nominal_joint.extra_z is None else length(place, "extra_z", nominal_joint.extra_z),
        )

    joints = tuple(joint(f"joint{i + 1}", nominal_joint) for i, nominal_joint in enumerate(model.arm.joints))
    return replace(model.arm, base=placement(BASE), joints=joints, tool=placement(TOOL))
