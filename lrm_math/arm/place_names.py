"""Names of places where effects act, such as `joint2`, `joint1+joint2`, `joint2<-joint3`: their joints, their words."""

from __future__ import annotations

import re
from functools import lru_cache


def place_words(place: str) -> str:
    """Words of a place: `joint 2`, `joints 1 and 2`, `joint 1 by joint 2`."""
    if both := re.fullmatch(r"joint(\d+)\+joint(\d+)", place):
        return f"joints {both[1]} and {both[2]}"
    return re.sub(r"([a-z])(\d+)", r"\1 \2", place).replace("<-", " by ")


def joint_numbers(place: str) -> tuple[int, ...]:
    """Numbers from 0 of the joints that a place names, in its order."""
    return tuple(joint_number(name) for name in re.findall(r"joint\d+", place))


@lru_cache(maxsize=256)
def joint_number(place: str) -> int:
    """Number from 0 of `jointN`."""
    return int(place.removeprefix("joint")) - 1
