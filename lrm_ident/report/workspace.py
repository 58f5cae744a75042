"""What people and machines read of capability maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich.console import Console

from lrm_ident.data.csv_table import table_text
from lrm_ident.report.fit import table
from lrm_ident.workspace.arm_variants import Variant
from lrm_ident.workspace.capability_map import Capability
from lrm_ident.workspace.voxel_grid import Area

AS_IT_IS = "as it is"


@dataclass(frozen=True, eq=False)
class Compared:
    """Maps of an arm (first) and its variants on one grid.

    Attributes:
        collisions: whether poses that collide were left out.
        orientations: how many were asked for in every cell.
        seconds: what all maps took together.
    """

    variants: tuple[Variant, ...]
    maps: tuple[Capability, ...]
    areas: tuple[Area, ...]
    orientations: int
    collisions: bool
    seconds: float

    @property
    def goals(self) -> int:
        """Poses asked for in all maps."""
        return sum(found.goals for found in self.maps)

    @property
    def goals_per_second(self) -> float:
        """Poses asked for in a second, most of them out of reach."""
        return self.goals / self.seconds

    def worth(self, found: Capability) -> float:
        """What maps are ranked by: the mean index over all areas, or the volume (m³) where no area is given."""
        return found.score(self.areas) if self.areas else found.volume

    @property
    def ranked(self) -> list[tuple[Variant, Capability]]:
        """Best first."""
        return sorted(zip(self.variants, self.maps, strict=True), key=lambda pair: self.worth(pair[1]), reverse=True)


def print_reach(console: Console, found: Compared) -> None:
    """The variants, best first, and how fast that was."""
    first = found.maps[0].grid
    areas = [f">{area.name} %" for area in found.areas]
    total = [">all areas %"] if len(areas) > 1 else []
    clear = "clear of collisions" if found.collisions else "collisions not looked at"
    title = f"{len(first)} cells of {first.step * 1e3:g} mm, {found.orientations} orientations each, {clear}"
    console.print(title, style="bold", highlight=False)
    rows = table("", "variant", ">volume L", ">index %", *areas, *total)
    for variant, capability in found.ranked:
        inside = [_percent(capability.within(area).index) for area in found.areas]
        score = [_percent(capability.score(found.areas))] if total else []
        volume = f"{capability.volume * 1e3:.1f}"
        rows.add_row(variant.name, volume, _percent(capability.everywhere.index), *inside, *score)
    console.print(rows)
    console.print(
        "index: share of all orientations that can be taken, the mean over the cells that can be reached at all, or "
        "over all cells of an area",
        style="dim",
    )
    console.print(
        f"{found.goals:,} goals in {found.seconds:.1f} s: {found.goals_per_second:,.0f} goals/s", highlight=False
    )


def reach_json(found: Compared) -> dict[str, Any]:
    """Result of `lrm-ident reach`, schema `lrm/reach/1`; the arm as it is comes first."""
    grid = found.maps[0].grid
    return {
        "schema": "lrm/reach/1",
        "arm": found.variants[0].arm.name,
        "step_mm": grid.step * 1e3,
        "cells": len(grid),
        "orientations": found.orientations,
        "collisions": found.collisions,
        "goals": found.goals,
        "seconds": found.seconds,
        "goals_per_s": found.goals_per_second,
        "areas": {
            area.name: {"from_mm": [1e3 * v for v in area.low], "to_mm": [1e3 * v for v in area.high]}
            for area in found.areas
        },
        "variants": [_variant(variant, capability, found) for variant, capability in _pairs(found)],
        "best": found.ranked[0][0].name,
    }


def _variant(variant: Variant, capability: Capability, found: Compared) -> dict[str, Any]:
    return {
        "name": variant.name,
        "volume_l": capability.volume * 1e3,
        "reachable": asdict(capability.everywhere),
        "areas": {area.name: asdict(capability.within(area)) for area in found.areas},
        "all_areas_index": capability.score(found.areas) if found.areas else None,
    }


def reach_rows(found: Compared) -> str:
    """CSV: a row for every cell that some variant reaches, with each variant's share of orientations."""
    index = np.stack([capability.index for capability in found.maps])
    some = (index > 0.0).any(axis=0)
    centres = found.maps[0].grid.centres[some] * 1e3
    places = [(f"{axis}_mm", centres[:, i], 3) for i, axis in enumerate("xyz")]
    shares = [(_column(variant), row, 6) for variant, row in zip(found.variants, index[:, some], strict=True)]
    return table_text([*places, *shares])


def _pairs(found: Compared) -> Sequence[tuple[Variant, Capability]]:
    return list(zip(found.variants, found.maps, strict=True))


def _column(variant: Variant) -> str:
    """A header without commas."""
    return f"index {variant.name}".replace(",", " ")


def _percent(share: float) -> str:
    return f"{100 * share:.2f}"
