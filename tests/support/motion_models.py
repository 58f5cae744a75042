"""Motion models of arms that swing, in memory and as files."""

from __future__ import annotations

from pathlib import Path

from lrm_math.arm.arm_file import load_arm
from lrm_math.motion.motion_model import MotionModel, effect_of


def swinging(arm: str = "lrm-rover", **joints: tuple[float, float]) -> MotionModel:
    """An arm of which some joints swing: frequency (Hz) and damping ratio."""
    model = MotionModel.nominal(load_arm(arm))
    for place, values in joints.items():
        effect = effect_of(model.arm, f"swing@{place}")
        known = {key: v for key, v in model.values.items() if key.split(".")[1] == place}
        both = (*model.of_joint(effect.joint), effect)
        model = model.with_joint(both, {**known, **dict(zip(effect.keys, (*values, 0.0), strict=True))}, {})
    return model


def motion_text(model: MotionModel) -> str:
    """The text of the model's file, of a shipped arm."""
    effects = ", ".join(f'"{effect.name}"' for effect in model.effects)
    numbers = "\n".join(f'"{key}" = {value}' for key, value in model.values.items())
    head = f'schema = "lrm/motion/2"\narm = "{model.arm.name}"\neffects = [{effects}]\n[parameters]\n'
    return f"{head}{numbers}\n"


def write_motion_model(model: MotionModel, path: Path) -> Path:
    """The model's file, of a shipped arm; the path."""
    path.write_text(motion_text(model), encoding="utf-8")
    return path


def motion_table(folder: Path, shaping: str) -> dict[str, str]:
    """Change of `lrmd.toml`'s text (`DaemonSetup.make`): a model of motion, written into a folder, and its shaping."""
    model = swinging(joint1=(3.0, 0.03), joint2=(4.0, 0.05), joint4=(6.0, 0.05))
    path = write_motion_model(model, folder / "motion.toml")
    return {"\n[state]\n": f'\n[motion]\nmodel = "{path}"\nshaping = "{shaping}"\n\n[state]\n'}
