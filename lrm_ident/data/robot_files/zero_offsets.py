"""Zero offsets of a model's joints, which files of servos can hold, and what else it has, which they cannot."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from lrm_ident.data.robot_files.urdf_export import zero_offset
from lrm_ident.data.wording import joint_labels
from lrm_math.effects import split_key
from lrm_math.errors import FileError, name_suggestion
from lrm_math.model.model import Model

ZERO = "theta_rad"


def zero_offsets(model: Model) -> dict[str, float]:
    """Angle of each joint where it is commanded zero (rad), names as in the robot's own description."""
    return {name: zero_offset(model, model.chain, i) for i, name in enumerate(joint_labels(model.arm))}


def beyond_zeros(model: Model) -> tuple[str, ...]:
    """Effects of a model, `effect@place`, that are more than zero offsets of joints."""
    out = []
    for effect, values in model.parts():
        rigid = effect.id == "offsets" and effect.place in model.arm.joint_names
        kept = [value for key, value in zip(effect.keys, values, strict=True) if split_key(key)[2] != ZERO]
        if not rigid:
            out.append(effect.name)
        elif any(kept):
            out.append(f"{effect.name} (its lengths and angles; its zero is)")
    return tuple(out)


def check_names(path: Path, model: Model, have: Iterable[str]) -> None:
    """Raises `FileError` where a file lacks one of the model's joints."""
    known = list(have)
    for name in zero_offsets(model):
        if name not in known:
            raise FileError(path, "", f"no joint '{name}'", name_suggestion(name, known))
