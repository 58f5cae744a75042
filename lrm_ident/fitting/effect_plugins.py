"""Effect plugins: effects of the catalogue, of installed packages (entry points), and of a Python file of the user."""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import sys
from collections.abc import Sequence
from importlib.metadata import entry_points
from pathlib import Path

from lrm_math.effects import CATALOGUE, Effect
from lrm_math.errors import FileError

ENTRY_POINTS = "lrm_arm.effects"
USER_MODULE = "effects_of_"
Catalogue = tuple[type[Effect], ...]


def catalogue_with(file: str | Path | None) -> Catalogue:
    """All available effects: shipped, from entry points of installed packages, and defined in `file`.

    Raises `FileError`: the file cannot be run, defines no effect, or one whose id is taken.
    """
    found: list[type[Effect]] = [*CATALOGUE, *(point.load() for point in entry_points(group=ENTRY_POINTS))]
    if file is not None:
        taken = {kind.id for kind in found}
        for kind in effects_in(Path(file)):
            if kind.id in taken:
                raise FileError(str(file), f"class {kind.__name__}", f"id '{kind.id}' is taken", "choose another one")
            found.append(kind)
    return tuple(found)


def effects_in(file: Path) -> list[type[Effect]]:
    """The effect classes that a Python file defines. Raises `FileError`."""
    spec = importlib.util.spec_from_file_location(USER_MODULE + file.stem, file)
    if not file.exists() or spec is None or spec.loader is None:
        raise FileError(file, "", "no such Python file")
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        line = f"line {error.lineno}" if isinstance(error, SyntaxError) else ""
        raise FileError(file, line, f"{type(error).__name__}: {error}") from None
    own = [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind) and issubclass(kind, Effect) and kind.__module__ == module.__name__
    ]
    if not own:
        raise FileError(file, "", "defines no effect", "a class that inherits from lrm_math.effects.Effect")
    for kind in own:
        _check(file, kind)
    return own


def file_of(effects: Sequence[Effect]) -> Path | None:
    """The Python file of the user that defines one of these effects, if any does."""
    modules = {type(effect).__module__ for effect in effects}
    found = [sys.modules[name].__file__ for name in sorted(modules) if name.startswith(USER_MODULE)]
    return Path(found[0]) if found and found[0] else None


def sha256_of(file: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal digits."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _check(file: Path, kind: type[Effect]) -> None:
    missing = [name for name in ("id", "cause", "formula", "source") if not isinstance(getattr(kind, name, None), str)]
    missing += sorted(kind.__abstractmethods__)
    if missing:
        right = "it needs id, cause, formula, source, places, parameters, and moves with motion (or another hook)"
        raise FileError(file, f"class {kind.__name__}", f"has no {missing[0]}", right)
