"""The board: conical sockets at the corners of a rectangle, and one on a post above its middle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import tomli_w

from lrm_math.errors import LrmError

COLUMNS, ROWS = 7, 5
"""Tiles of the plate; a socket is in the middle of each corner's tile."""
RAISED = "E"
LEAST_MM, MOST_MM, LOWEST_MM = 30.0, 400.0, 5.0
"""Of sides, and of the post."""


@dataclass(frozen=True)
class SocketBoard:
    """Sockets A, B, C, D at the corners of a rectangle of `length_mm` × `width_mm`, E `raised_mm` above its middle.

    `opening_mm`: diameter of a cone of 90 deg where it ends. `thickness_mm`: of the plate. Its frame stands in the
    centre of A's opening, x towards B, y towards D, z up. Raises `LrmError`: sockets that are too large or too far
    apart, or a plate that is thinner than they are deep.
    """

    length_mm: float = 160.0
    width_mm: float = 130.0
    raised_mm: float = 60.0
    opening_mm: float = 12.0
    thickness_mm: float = 10.0

    def __post_init__(self) -> None:
        sides = (self.length_mm, self.width_mm)
        if not all(LEAST_MM <= side <= MOST_MM for side in sides):
            raise LrmError(f"a board of {sides[0]:g} x {sides[1]:g} mm; should be {LEAST_MM:g} to {MOST_MM:g} mm")
        if not 3.0 <= self.opening_mm <= 0.8 * min(self.tile):
            raise LrmError(f"sockets of {self.opening_mm:g} mm; should be 3 to {0.8 * min(self.tile):.1f} mm here")
        if self.raised_mm and not LOWEST_MM <= self.raised_mm <= MOST_MM:
            raise LrmError(f"E raised by {self.raised_mm:g} mm; should be 0, or {LOWEST_MM:g} to {MOST_MM:g} mm")
        least = self.opening_mm / 2.0 + 2.0
        if self.thickness_mm < least:
            raise LrmError(f"a plate of {self.thickness_mm:g} mm; should be {least:g} mm for its sockets")

    @property
    def tile(self) -> tuple[float, float]:
        """Sides of a tile (mm)."""
        return self.length_mm / (COLUMNS - 1), self.width_mm / (ROWS - 1)

    @property
    def points(self) -> dict[str, tuple[float, float, float]]:
        """Centre of each socket's opening (mm), by name."""
        x, y = self.length_mm, self.width_mm
        corners = {"A": (0.0, 0.0, 0.0), "B": (x, 0.0, 0.0), "C": (x, y, 0.0), "D": (0.0, y, 0.0)}
        return corners | ({RAISED: (x / 2.0, y / 2.0, self.raised_mm)} if self.raised_mm else {})

    @property
    def distances(self) -> dict[str, float]:
        """Distance (mm) between the centres of any two openings, by both names."""
        places = self.points
        return {f"{a}-{b}": math.dist(places[a], places[b]) for a, b in combinations(places, 2)}

    @property
    def flat(self) -> SocketBoard:
        """The board without the post, as it can be drilled."""
        return SocketBoard(self.length_mm, self.width_mm, 0.0, self.opening_mm, self.thickness_mm)

    def metadata(self, arm: str | None = None) -> str:
        """Text of the file beside touches of this board; the nominal places are to be replaced by measured ones."""
        named = {"arm": arm} if arm else {}
        points = "".join(f"{name} = {[*place]}\n" for name, place in self.points.items())
        distances = "".join(f"# {pair} = {value:.2f}\n" for pair, value in self.distances.items())
        head = tomli_w.dumps({"schema": "lrm/measurements/1", **named})
        measured = f"# what you measured, without the # (mm); it corrects the places above\n{distances}"
        return f"{head}\n[points]\n# nominal (mm)\n{points}\n[distances]\n{measured}"
