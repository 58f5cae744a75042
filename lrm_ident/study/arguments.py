"""Arguments as people give them in Python: what is of the wrong kind is said in one line, and what would be right."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from pydantic import ValidationError

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
K = TypeVar("K")


def options_in_python(read: Callable[P, R]) -> Callable[P, R]:
    """A function that reads a file; to its errors it adds the options that they advise, as Python takes them."""

    @wraps(read)
    def with_advice(*args: P.args, **kwargs: P.kwargs) -> R:
        """Call it; a note with the options is added to what it raises."""
        try:
            return read(*args, **kwargs)
        except LrmError as error:
            said = {name.replace("-", "_"): text for name, text in OPTION.findall(str(error))}
            fields = [f"{name}={_literal(text)}" for name, text in said.items() if name in Reading.model_fields]
            if fields:
                error.add_note(f"in Python: reading=lrm.Reading({', '.join(fields)})")
            raise

    return with_advice


def _literal(text: str) -> str:
    """The text of an option as Python writes its value: whole numbers by commas are a list."""
    numbers = re.fullmatch(r"-?\d+(,-?\d+)*", text)
    return f"[{text.replace(',', ', ')}]" if numbers else f'"{text}"'


def of_kind(value: object, kind: type[K], what: str, right: str) -> K:
    """The value. Raises `LrmError` if it is of another kind: what should stand there, and what gives it."""
    if isinstance(value, kind):
        return value
    kind_given = type(value).__name__
    article = "an" if kind_given[0].lower() in "aeiou" or kind_given == "ndarray" else "a"
    raise LrmError(f"{article} {kind_given} stands where {what} should; {right}")


def path_of(file: str | Path) -> Path:
    """The path of a file. Raises `LrmError`: a table, or anything else that is no path."""
    right = "write the table to a CSV first, table.to_csv('my.csv', index=False), and give its path"
    return Path(file) if isinstance(file, str) else of_kind(file, Path, "the path of a file", right)


def arm_named(arm: str | Path) -> str:
    """Name or path of an arm, as model files keep it. Raises `LrmError`: an arm itself, or anything else."""
    right = "arm='so101', or the path of an arm file: arm='mine.toml'"
    return of_kind(str(arm) if isinstance(arm, Path) else arm, str, "the name of an arm", right)


def reading_of(reading: Reading | Mapping[str, Any]) -> Reading:
    """The reading, also as a mapping of its fields. Raises `LrmError`: anything else, or a field that is not valid."""
    if not isinstance(reading, Mapping):
        return of_kind(reading, Reading, "a reading", 'lrm.Reading(angle_unit="rad")')
    try:
        return Reading(**reading)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        raise LrmError(f"reading: {fault['loc'][0]}: {fault['msg']}") from None


def effect_named(effect: object) -> str:
    """Name of an effect: itself, or that of a candidate of a diagnosis. Raises `LrmError`: anything else."""
    right = "study.add('backlash@joint2'), or the first of a diagnosis: study.add(found.first)"
    return of_kind(getattr(effect, "name", effect), str, "the name of an effect", right)


def names_of(names: str | Sequence[str]) -> list[str]:
    """Names as a list, or by commas in one text, as the commands take them."""
    return [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)


def measurements_of(data: object) -> Measurements:
    """The measurements. Raises `LrmError`: anything else."""
    return of_kind(data, Measurements, "measurements", "lrm.load('my.csv', arm='so101') gives them")


def model_of_fit(model: object) -> Model:
    """The model, that of a fit or study too. Raises `LrmError`: anything else."""
    the_model = getattr(model, "model", model)
    right = "lrm.fit(data) or lrm.load_model('model.toml') gives it"
    return the_model if isinstance(the_model, Model) else of_kind(model, Model, "a model", right)


def check_same_arm(model: Model, arm: Arm | None) -> None:
    """Raises `LrmError` if measurements are of another arm than a model."""
    if arm is not None and arm_sha256(arm) != arm_sha256(model.arm):
        differ = f": {WHAT_COUNTS} differ" if arm.name == model.arm.name else f", the measurements of {arm.name}"
        raise LrmError(f"the model is of {model.arm.name}{differ}; load them with the arm of the model")


def check_poses(model: Model, poses: object) -> None:
    """Raises `LrmError` if these are no poses, or of an arm with another number of joints."""
    right = "data.poses, lrm.load_poses('poses.csv', 'so101'), or poses_of(q_rad) of lrm_math.kinematics.poses"
    joints = of_kind(poses, Poses, "poses", right).q.shape[1]
    if joints != model.arm.dof:
        arm = f"{model.arm.name} has {model.arm.dof}"
        raise LrmError(f"the poses are of {joints} joints, {arm}; is the model of another arm?")
