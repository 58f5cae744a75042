"""Arguments as people give them in Python: what is of the wrong kind is said in one line, and what would be right."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import wraps
from os import PathLike
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from lrm_ident.data.measurements import Measurements
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_digest import WHAT_COUNTS, arm_sha256
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.model import Model
from lrm_math.model.reading import Reading

OPTION = re.compile(r"--([a-z-]+)[ =]([^\s;,()]+(?:,[^\s;,()]+)*)")
"""An option and its value, as messages name them for the command line."""
P = ParamSpec("P")
R = TypeVar("R")


def options_in_python(read: Callable[P, R]) -> Callable[P, R]:
    """A function that reads a file; to its errors it adds the options that they advise, as Python takes them."""

    @wraps(read)
    def reading(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return read(*args, **kwargs)
        except LrmError as error:
            said = {name.replace("-", "_"): text for name, text in OPTION.findall(str(error))}
            fields = [f"{name}={_literal(text)}" for name, text in said.items() if name in Reading.model_fields]
            if fields:
                error.add_note(f"in Python: reading=lrm.Reading({', '.join(fields)})")
            raise

    return reading


def _literal(text: str) -> str:
    """The text of an option as Python writes its value: whole numbers by commas are a list."""
    numbers = re.fullmatch(r"-?\d+(,-?\d+)*", text)
    return f"[{text.replace(',', ', ')}]" if numbers else f'"{text}"'


def path_of(file: str | PathLike[str]) -> Path:
    """The path of a file. Raises `LrmError`: a table, or anything else that is no path."""
    if isinstance(file, str | PathLike):
        return Path(file)
    right = "write the table to a CSV first, table.to_csv('my.csv', index=False), and give its path"
    raise LrmError(f"{_a(file)} stands where the path of a file should; {right}")


def names_of(names: str | Sequence[str]) -> list[str]:
    """Names as a list, or by commas in one text, as the commands take them."""
    return [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)


def measurements_of(data: object) -> Measurements:
    """The measurements. Raises `LrmError`: anything else."""
    if isinstance(data, Measurements):
        return data
    raise LrmError(f"{_a(data)} stands where measurements should; lrm.load('my.csv', arm='so101') gives them")


def model_of_fit(model: object) -> Model:
    """The model, that of a fit or study too. Raises `LrmError`: anything else."""
    own = model if isinstance(model, Model) else getattr(model, "model", None)
    if isinstance(own, Model):
        return own
    raise LrmError(f"{_a(model)} stands where a model should; lrm.fit(data) or lrm.load_model('model.toml') gives it")


def check_same_arm(model: Model, arm: Arm | None) -> None:
    """Raises `LrmError` if measurements are of another arm than a model."""
    if arm is not None and arm_sha256(arm) != arm_sha256(model.arm):
        differ = f": {WHAT_COUNTS} differ" if arm.name == model.arm.name else f", the measurements of {arm.name}"
        raise LrmError(f"the model is of {model.arm.name}{differ}; load them with the arm of the model")


def check_poses(model: Model, poses: object) -> None:
    """Raises `LrmError` if these are no poses, or of an arm with another number of joints."""
    if not isinstance(poses, Poses):
        right = "data.poses, lrm.load_poses('poses.csv', 'so101'), or poses_of(q_rad) of lrm_math.kinematics.poses"
        raise LrmError(f"{_a(poses)} stands where poses should; {right}")
    if poses.q.shape[1] != model.arm.dof:
        arm = f"{model.arm.name} has {model.arm.dof}"
        raise LrmError(f"the poses are of {poses.q.shape[1]} joints, {arm}; is the model of another arm?")


def _a(value: Any) -> str:
    kind = type(value).__name__
    return f"{'an' if kind[0].lower() in 'aeiou' or kind == 'ndarray' else 'a'} {kind}"
