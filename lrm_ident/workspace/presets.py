"""What is compared when nobody says what: the places and the variants of arms whose work is known."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product


@dataclass(frozen=True)
class Study:
    """Areas and variants in the words of the command, and pairs of shapes that may touch at work."""

    areas: tuple[str, ...] = ()
    variants: tuple[str, ...] = ()
    may_touch: tuple[str, ...] = ()


def _joined(*changes: str) -> str:
    return ",".join(change for change in changes if change)


_CHANGES = product(("", "base_beta_deg=45"), ("", "link2-10mm", "link2+10mm"), ("", "link4-10mm", "link4-20mm"))
ROVER = Study(
    areas=("ground=50:350,-150:150,0:90", "basket=-240:-120,-90:90,210:300"),
    variants=tuple(_joined(*changes) for changes in _CHANGES if any(changes)),
    may_touch=("fingers:ground",),
)
"""Thesis section 3.1: the first link at 45° or 60°, links 2 and 4 as they first were or longer by 1 or 2 cm. What was
chosen is the shipped arm: 60°, link 2 longer by 1 cm, link 4 by 2 cm. The thesis names its two areas, the ground behind
the rover and the basket on its back, and gives no numbers; these are estimates."""

STUDIES = {"lrm-rover": ROVER}
"""By the name of the arm."""


def study_of(arm_name: str) -> Study:
    """What is usually compared of an arm: nothing for one that is not known."""
    return STUDIES.get(arm_name, Study())
