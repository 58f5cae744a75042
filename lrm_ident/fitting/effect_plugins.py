"""Effect plugins: effects of the catalogue, of installed packages (entry points), and of a Python file of the user."""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import sys
from collections.abc import Sequence
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np

from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.effects import CATALOGUE, Description, Effect, LinearEffect
from lrm_math.errors import FileError, LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.model import model_of

ENTRY_POINTS = "lrm_arm.effects"
USER_MODULE = "effects_of_"
Catalogue = tuple[type[Effect], ...]


def catalogue_with(file: str | Path | None) -> Catalogue:
    """All available effects: shipped, from entry points of installed packages, and defined in `file`.

    Raises `FileError`: the file cannot be run, defines no effect, or one whose id is taken.
    """
    kinds: list[type[Effect]] = [*CATALOGUE, *(point.load() for point in entry_points(group=ENTRY_POINTS))]
    if file is not None:
        taken = {kind.id for kind in kinds}
        for kind in effects_in(Path(file)):
            if kind.id in taken:
                raise FileError(str(file), f"class {kind.__name__}", f"id '{kind.id}' is taken", "choose another one")
            kinds.append(kind)
    return tuple(kinds)


def effects_in(file: Path) -> list[type[Effect]]:
    """The effect classes that a Python file defines. Raises `FileError`."""
    spec = importlib.util.spec_from_file_location(USER_MODULE + file.stem, file)
    if not file.exists() or spec is None or spec.loader is None:
        what = "is no Python file" if file.exists() else "no such file"
        raise FileError(file, "", what, "a .py file with classes of effects")
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        line = f"line {error.lineno}" if isinstance(error, SyntaxError) else ""
        raise FileError(file, line, f"{type(error).__name__}: {error}") from None
    classes = [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind) and issubclass(kind, Effect) and kind.__module__ == module.__name__
    ]
    if not classes:
        raise FileError(file, "", "defines no effect", "a class that inherits from lrm_math.effects.Effect")
    for kind in classes:
        _check(file, kind)
    return classes


def file_of(effects: Sequence[Effect]) -> Path | None:
    """The Python file of the user that defines one of these effects, if any does."""
    modules = {type(effect).__module__ for effect in effects}
    files = [sys.modules[name].__file__ for name in sorted(modules) if name.startswith(USER_MODULE)]
    return Path(files[0]) if files and files[0] else None


def sha256_of(file: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal digits."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _check(file: Path, kind: type[Effect]) -> None:
    """Raises `FileError` for a class that lacks part of the contract, or fails on a shipped arm (`_try`)."""
    texts = (("id", str), ("about", Description))
    missing = [name for name, expected in texts if not isinstance(getattr(kind, name, None), expected)]
    missing += sorted(kind.__abstractmethods__)
    if missing:
        right = "it needs id, about, places, parameters, targets and amounts (or basis of a LinearEffect)"
        raise FileError(file, f"class {kind.__name__}", f"has no {missing[0]}", f"{right}; see docs/effects.md")
    arms = (load_arm(name) for name in shipped_arms())
    effect = next((kind(arm, kind.places(arm)[0]) for arm in arms if kind.places(arm)), None)
    if effect is not None:
        _try(file, effect)


def _try(file: Path, effect: Effect) -> None:
    """Evaluates an effect at two poses of a shipped arm. Raises `FileError`: it fails, or gives the wrong shapes."""
    where = f"class {type(effect).__name__}"
    poses, parameters = poses_of(np.full((2, effect.arm.dof), 0.3)), effect.parameters
    tau, p = (np.ones(2),) * len(effect.load_slots), [parameter.typical for parameter in parameters]
    right = f"one number or (N,) for each of its {len(effect.targets)} targets, in a tuple"
    if isinstance(effect, LinearEffect):
        right = f"for each of its {len(parameters)} parameters a tuple: {right}"
    try:
        linear, size = isinstance(effect, LinearEffect), len(effect.targets)
        rows = effect.basis(poses, tau) if isinstance(effect, LinearEffect) else (effect.amounts(poses, tau, p),)
        if linear and len(rows) != len(parameters):
            raise FileError(file, where, f"basis gives {len(rows)} rows", right)
        shaped = all(isinstance(row, tuple) and len(row) == size for row in rows)
        if not shaped or any(np.shape(amount) not in ((), (2,)) for row in rows for amount in row):
            raise FileError(file, where, "gives amounts of another shape", right)
        for parameter in parameters:
            parameter.unit  # noqa: B018 - raises for a name without one
        model_of(effect.arm, [effect]).binding  # noqa: B018 - raises for slots that the arm has not
    except (FileError, LrmError) as error:
        raise error if isinstance(error, FileError) else FileError(file, where, str(error)) from None
    except Exception as error:
        if isinstance(error, IndexError) and not tau:
            right = "load_slots: the slots whose loads it reads in tau; it has none"
        raise FileError(file, where, f"fails at two poses of {effect.arm.name}: {error!r}", right) from None
