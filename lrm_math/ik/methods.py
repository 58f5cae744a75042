"""The methods of calibrated inverse kinematics by name: strategies over one engine. To add one: its file, its line."""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache
from typing import Any

from lrm_math.errors import UnknownName
from lrm_math.ik.calibrated_arm import Method
from lrm_math.ik.cube import Cube
from lrm_math.ik.direct import Direct
from lrm_math.ik.iterative import Iterative

METHODS: dict[str, type[Cube | Direct | Iterative]] = {kind.name: kind for kind in (Cube, Direct, Iterative)}
DEFAULT: Method = Cube()
QUICKEST: Method = Direct()


@lru_cache(maxsize=64)
def method_named(name: str, **options: Any) -> Method:
    """A method with those of its settings that are among `options`, which may be other methods' too.

    Raises `UnknownName`, and `LrmError` for impossible settings.
    """
    if name not in METHODS:
        raise UnknownName("method of inverse kinematics", name, METHODS)
    own = {field.name for field in fields(METHODS[name])}
    return METHODS[name](**{key: value for key, value in options.items() if key in own})
