"""What the words of a command line stand for."""

from __future__ import annotations

import argparse
import getpass

from lrm_math.errors import LrmError, nearest
from lrmd.cli.angles import angle_of, angles_of
from lrmd.client.rover import Rover


def rover_of(o: argparse.Namespace) -> Rover:
    """The session that the options ask for."""
    return Rover(o.robot, o.connect.split(",") if o.connect else None, o.zenoh_config)


def holder() -> str:
    """What the lease says of who commands."""
    return f"lrm ({getpass.getuser()})"


def joints(rover: Rover, text: str) -> dict[str, float]:
    """An angle (rad) for each joint of the arm, by name. Raises `LrmError`."""
    angles, who = angles_of(text), rover.info()
    if len(angles) != who.joints:
        raise LrmError(f"--q has {len(angles)} angles; {who.arm} has {who.joints} joints")
    return dict(zip(who.names, angles, strict=False))


def named(rover: Rover, pairs: list[tuple[str, str]]) -> dict[str, float]:
    """Angles (rad) by the names of servos. Raises `LrmError`."""
    names = rover.info().names
    for name, _ in pairs:
        if name not in names:
            raise LrmError(f"unknown servo '{name}'; {nearest(name, names)}")
    return {name: angle_of(text) for name, text in pairs}


def numbers(name: str, text: str) -> list[float]:
    """The numbers of the option `name`. Raises `LrmError`."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise LrmError(f"{name} {text}: should be numbers with commas between them") from None


def three(name: str, values: list[float]) -> list[float]:
    """The values of the option `name`, if they are three. Raises `LrmError`."""
    if len(values) != 3:
        raise LrmError(f"{name} has {len(values)} numbers; should be three with commas between them")
    return values
