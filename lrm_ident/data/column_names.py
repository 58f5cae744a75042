"""Names of columns: capitals, usual aliases, and units in names, as the names of our own files (docs/files.md)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lrm_ident.data.apply_reading import ANGLE_UNITS, LENGTH_UNITS

UNIT_WORDS = {
    "mm": "mm", "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm",
    "cm": "cm", "centimeter": "cm", "centimeters": "cm",
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "um": "um", "µm": "um", "μm": "um", "micron": "um", "microns": "um", "micrometer": "um",
    "in": "inch", "inch": "inch", "inches": "inch",
    "deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "grad": "grad",
    "rad": "rad", "radian": "rad", "radians": "rad",
    "s": "s", "sec": "s", "seconds": "s", "g": "g", "gram": "g", "grams": "g", "kg": "kg",
    "c": "c", "°c": "c", "v": "v",
}  # fmt: skip
FACTORS = {
    "mm": {unit: metres / LENGTH_UNITS["mm"] for unit, metres in LENGTH_UNITS.items()},
    "deg": {"deg": 1.0, "rad": ANGLE_UNITS["rad"] / ANGLE_UNITS["deg"]},
    "g": {"g": 1.0, "kg": 1e3},
    "s": {"s": 1.0},
    "c": {"c": 1.0},
    "v": {"v": 1.0},
    "": {},
}
"""File units of our own columns, and what other units are in them."""

JOINT = re.compile(
    r"(?:q|j|a|joint|axis|theta|th|θ|angle|motor|servo)(?:angle|pos|position)?(\d+)(?:angle|pos|position)?"
)
POSITION = re.compile(
    r"(?:(?:tcp|tool|ee|eef|pos|position|p|meas|measured|target|tracker)+)?([xyz])(?:tcp|tool|pos|meas|measured)?"
)
OTHERS = {
    "pose": ("pose", "nr", "no", "num", "number", "index", "idx", "id", "posenumber", "poseid", "posenr", "sample"),
    "t_s": ("t", "time", "timestamp"),
    "session": ("session",),
    "payload_g": ("payload", "load", "mass"),
    "temp_c": ("temp", "temperature"),
    "supply_v": ("supply", "voltage"),
    "sd_mm": ("sd", "std", "sigma"),
    "distance_mm": ("distance", "dist", "wire", "string", "ballbar"),
    "distance_sd_mm": ("distancesd",),
    "repeat_of": ("repeatof", "repeat"),
    "approach": ("approach", "direction"),
    "qw": ("qw",), "qx": ("qx",), "qy": ("qy",), "qz": ("qz",),
}  # fmt: skip
ALIASES = {alias: name for name, aliases in OTHERS.items() for alias in aliases}


@dataclass(frozen=True)
class ColumnName:
    """A column by our own `name`; `factor`: one unit of the file's in ours; `unit`: as the file states it, or None."""

    name: str
    factor: float = 1.0
    unit: str | None = None


def column_name(text: str, joints: Sequence[str] = ()) -> ColumnName | None:
    """Meaning of a column of a measurement file; None if its name is not known, or its unit does not fit it.

    `joints`: names of an arm's joints, from the first on, as its own description has them.
    """
    named = joint_names(joints)
    for words, unit in _readings(text):
        name = named.get(words) or named.get(words.removesuffix("pos")) or _own_name(words)
        if name is None:
            continue
        own = next((end for end in ("mm", "deg", "g", "s", "c", "v") if name.endswith(f"_{end}")), "")
        if unit is None:
            return ColumnName(name)
        if unit in FACTORS[own]:
            return ColumnName(name, FACTORS[own][unit], unit)
    return None


def unit_word(text: str) -> str | None:
    """The unit that a cell names, bare or in brackets; None if it names none."""
    return UNIT_WORDS.get(text.strip().lower().strip("[]()"))


def joint_names(joints: Sequence[str]) -> dict[str, str]:
    """Our names of the columns of joints by the arm's own, squeezed."""
    return {_squeezed(name.lower()): f"q{number}_deg" for number, name in enumerate(joints, start=1)}


def bare_names(text: str) -> Iterator[str]:
    """Names that a column may have, without its unit and the word for a position."""
    for words, _ in _readings(text):
        yield from (words, words.removesuffix("pos"))


def _readings(text: str) -> Iterator[tuple[str, str | None]]:
    """The name without its unit, and the unit: `X [mm]`, `x(mm)`, `x_mm`, `x mm`, `Xmm` after a digit, or no unit."""
    plain = text.strip().lower()
    bracketed = re.fullmatch(r"(.*?)[\s_]*[\[(]\s*(.+?)\s*[\])]", plain)
    if bracketed:
        if bracketed[2] in UNIT_WORDS:
            yield _squeezed(bracketed[1]), UNIT_WORDS[bracketed[2]]
        return
    divided = re.fullmatch(r"(.+?)[\s_./-]+([^\s_./-]+)", plain)
    if divided and divided[2] in UNIT_WORDS:
        yield _squeezed(divided[1]), UNIT_WORDS[divided[2]]
    yield _squeezed(plain), None


def _squeezed(name: str) -> str:
    return re.sub(r"[\s_./-]+", "", name)


def _own_name(words: str) -> str | None:
    joint = JOINT.fullmatch(words)
    if joint:
        return f"q{int(joint[1])}_deg"
    position = POSITION.fullmatch(words)
    if position:
        return f"{position[1]}_mm"
    return ALIASES.get(words)
