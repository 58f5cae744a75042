"""The thesis's letters for parameters (Conenna 2024, Table 4.3 and section 4.3), short enough for a figure."""

from __future__ import annotations

from lrm_math.effects import split_key

GREEK = {"alpha": "α", "beta": "β", "gamma": "γ", "theta": "θ"}


def symbol(key: str) -> str:
    """`offsets.joint1.d_mm` → δd1, `offsets.base.z_mm` → δz_b, `compliance.base.k_rad_per_Nm` → k0.

    The further translation of link i stands in the thesis at the joint that it leads to: `offsets.joint2.extra_z_mm` →
    δdd3. Parameters that the thesis does not have keep their key.
    """
    effect, place, name = split_key(key)
    bare = name.rsplit("_", 1)[0] if effect == "offsets" else name
    joint = int(place.removeprefix("joint")) if place.startswith("joint") and place[5:].isdigit() else None
    if effect == "compliance":
        return f"k{joint or 0}"
    if effect != "offsets":
        return key
    if joint is None:
        return f"δ{GREEK.get(bare, bare)}_{place[0]}"
    return f"δdd{joint + 1}" if bare == "extra_z" else f"δ{GREEK.get(bare, bare)}{joint}"
