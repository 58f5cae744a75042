"""Default areas and variants of the capability map, by arm."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product


@dataclass(frozen=True)
class WorkspaceStudy:
    """Areas and variants in the syntax of the command line, and pairs of shapes that may touch."""

    areas: tuple[str, ...] = ()
    variants: tuple[str, ...] = ()
    may_touch: tuple[str, ...] = ()


_CHANGES = product(("", "base_beta_deg=45"), ("", "link2-10mm", "link2+10mm"), ("", "link4-10mm", "link4-20mm"))
ROVER = WorkspaceStudy(
    areas=("ground=50:350,-150:150,0:90", "basket=-240:-120,-90:90,210:300"),
    variants=tuple(",".join(filter(None, changes)) for changes in _CHANGES if any(changes)),
    may_touch=("fingers:ground",),
)
"""Thesis section 3.1: the first link at 45° or 60°, links 2 and 4 as first designed or longer by 1 or 2 cm. The choice,
60°, +1 cm, +2 cm, is the shipped arm. The thesis gives no dimensions of its two areas, the ground behind the rover and
the basket on its back; these are estimates."""


def default_study(arm_name: str) -> WorkspaceStudy:
    """The study of the arm of that name; an empty one for other arms."""
    return ROVER if arm_name == "lrm-rover" else WorkspaceStudy()
