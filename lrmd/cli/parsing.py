"""Parsing of command-line words: the daemon's session, angles, vectors, names of servos."""

from __future__ import annotations

import argparse
import getpass
import math
import re
from collections.abc import Sequence

from lrm_math.errors import LrmError, name_suggestion
from lrmd.client import Rover

_ANGLE = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*(deg|°|rad)?\s*", re.IGNORECASE)


HEAVIEST_G, FARTHEST_MM = 2000.0, 100_000.0
"""Bounds of the daemon's messages (`Payload`, `Position`) in the units of the command line."""


def parse_angle(text: str) -> float:
    """Radians from a number with `deg`, `rad` or no unit (degrees). Raises `LrmError`."""
    match = _ANGLE.fullmatch(text)
    value = math.nan if match is None else float(match[1])
    if match is None or not math.isfinite(value):
        raise LrmError(f"angle '{text}': should be like 30deg, 30 (degrees) or 0.5rad")
    return value if (match[2] or "").lower() == "rad" else math.radians(value)


def parse_angles(text: str) -> list[float]:
    """Radians from comma-separated angles. Raises `LrmError`."""
    return [parse_angle(word) for word in text.split(",")]


def open_rover(o: argparse.Namespace) -> Rover:
    """The session chosen by the options `--robot`, `--connect` and `--zenoh-config`."""
    return Rover(o.robot, o.connect.split(",") if o.connect else None, o.zenoh_config)


def payload_kg(o: argparse.Namespace) -> float | None:
    """The payload (kg) of the option `--payload-g`, None for what the arm carries already. Raises `LrmError`."""
    if o.payload_g is not None and not 0.0 <= o.payload_g <= HEAVIEST_G:
        raise LrmError(f"--payload-g {o.payload_g:g}: should be 0 to {HEAVIEST_G:g} g")
    return None if o.payload_g is None else float(o.payload_g) / 1000


def place_m(words: str, millimetres: Sequence[float]) -> list[float]:
    """A place (m) from three numbers of mm; `words`: where they stand. Raises `LrmError`: one is no place of a tool."""
    if not all(abs(value) <= FARTHEST_MM for value in millimetres):
        given = " ".join(f"{value:g}" for value in millimetres)
        raise LrmError(f"{words} {given}: should be three places in mm, none beyond {FARTHEST_MM:g}")
    return [value / 1000 for value in millimetres]


def lease_holder() -> str:
    """Name under which the lease is requested."""
    return f"lrm ({getpass.getuser()})"


def joint_angles(rover: Rover, text: str) -> dict[str, float]:
    """Angle (rad) of each joint, by name, from comma-separated angles. Raises `LrmError`."""
    angles, info = parse_angles(text), rover.info()
    if len(angles) != info.joints:
        raise LrmError(f"--q has {len(angles)} angles; {info.arm} has {info.joints} joints")
    return dict(zip(info.names, angles, strict=False))


def servo_angles(rover: Rover, pairs: list[tuple[str, str]]) -> dict[str, float]:
    """Angles (rad) by name, from pairs of name and angle. Raises `LrmError`."""
    names, given = rover.info().names, [name for name, _ in pairs]
    for name in given:
        if name not in names:
            raise LrmError(f"unknown servo '{name}'; {name_suggestion(name, names)}")
        if given.count(name) > 1:
            raise LrmError(f"{name} is given twice: which angle is meant?")
    return {name: parse_angle(text) for name, text in pairs}
