"""Names of places where effects act, such as `joint2`, `joint1+joint2`, `joint2<-joint3`: their joints, their words."""

from __future__ import annotations

import re
from functools import lru_cache

BY = "<-"
"""Between a joint and the one that turns it."""


def turned_by(joint: str, other: str) -> str:
    """The place of a joint that another one turns: `joint3<-joint2`."""
    return f"{joint}{BY}{other}"


def both(joint: str, other: str) -> str:
    """The place of two joints together: `joint1+joint2`."""
    return f"{joint}+{other}"


@lru_cache(maxsize=256)
def joints_of(place: str) -> tuple[str, ...]:
    """The joints that a place names, in its order."""
    return tuple(re.findall(r"joint\d+", place))


def place_words(place: str) -> str:
    """Words of a place: `joint 2`, `joints 1 and 2`, `joint 1 by joint 2`."""
    if pair := re.fullmatch(r"joint(\d+)\+joint(\d+)", place):
        return f"joints {pair[1]} and {pair[2]}"
    return re.sub(r"([a-z])(\d+)", r"\1 \2", place).replace("<-", " by ")


def joint_numbers(place: str) -> tuple[int, ...]:
    """Numbers from 0 of the joints that a place names, in its order."""
    return tuple(map(joint_number, joints_of(place)))


@lru_cache(maxsize=256)
def joint_number(place: str) -> int:
    """Number from 0 of `jointN`."""
    return int(place.removeprefix("joint")) - 1
