"""Report of `reach`: capability maps of an arm and its variants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from rich.text import Text

from lrm_ident.design.workspace.arm_variants import ArmVariant
from lrm_ident.design.workspace.capability_map import CapabilityMap
from lrm_ident.design.workspace.voxel_grid import Area
from lrm_ident.report.document import Block, Document, ResultTable, heading

AS_IT_IS = "as it is"
INDEX_MEANING = (
    "index: share of all orientations that can be taken, the mean over the cells that can be reached at all, or "
    "over all cells of an area"
)


@dataclass(frozen=True, eq=False)
class VariantComparison:
    """Maps of an arm (first) and its variants on one grid.

    Attributes:
        collisions: whether poses that collide were left out.
        orientations: how many were tried in every cell.
        seconds: what all maps took together.
    """

    variants: tuple[ArmVariant, ...]
    maps: tuple[CapabilityMap, ...]
    areas: tuple[Area, ...]
    orientations: int
    collisions: bool
    seconds: float

    @property
    def goals(self) -> int:
        """Target poses of all maps."""
        return sum(found.goals for found in self.maps)

    @property
    def goals_per_second(self) -> float:
        """Target poses in a second, most of them out of reach."""
        return self.goals / self.seconds

    def criterion(self, found: CapabilityMap) -> float:
        """The criterion that ranks maps: the mean index over all areas, or the volume (m³) where no area is given."""
        return found.score(self.areas) if self.areas else found.volume

    @property
    def ranked(self) -> list[tuple[ArmVariant, CapabilityMap]]:
        """Best first."""
        pairs = zip(self.variants, self.maps, strict=True)
        return sorted(pairs, key=lambda pair: self.criterion(pair[1]), reverse=True)


def reach_document(found: VariantComparison) -> Document:
    """Result of `lrm-ident reach`, schema `lrm/reach/1`: the variants, best first, and the speed of the solver."""
    grid, pairs = found.maps[0].grid, list(zip(found.variants, found.maps, strict=True))
    clear = "clear of collisions" if found.collisions else "collisions not looked at"
    total = found.areas if len(found.areas) > 1 else ()
    columns = ["variant", "volume L|.1f", "index %|.2f", *(f"{area.name} %|.2f" for area in found.areas)]
    rows = []
    for variant, capability in found.ranked:
        shares = [capability.everywhere.index, *(capability.within(area).index for area in found.areas)]
        shares += [capability.score(total)] if total else []
        rows.append((variant.name, capability.volume * 1e3, *(100 * share for share in shares)))
    blocks: list[Block] = [
        heading(f"{len(grid)} cells of {grid.step * 1e3:g} mm, {found.orientations} orientations each, {clear}"),
        ResultTable([*columns, "all areas %|.2f"] if total else columns, rows),
        Text(INDEX_MEANING, style="dim"),
        f"{found.goals:,} goals in {found.seconds:.1f} s: {found.goals_per_second:,.0f} goals/s",
    ]
    values = {
        "arm": found.variants[0].arm.name,
        "step_mm": grid.step * 1e3,
        "cells": len(grid),
        "orientations": found.orientations,
        "collisions": found.collisions,
        "goals": found.goals,
        "seconds": found.seconds,
        "goals_per_s": found.goals_per_second,
        "areas": {
            area.name: {"from_mm": 1e3 * np.array(area.low), "to_mm": 1e3 * np.array(area.high)} for area in found.areas
        },
        "variants": [
            {
                "name": variant.name,
                "volume_l": capability.volume * 1e3,
                "reachable": capability.everywhere,
                "areas": {area.name: capability.within(area) for area in found.areas},
                "all_areas_index": capability.score(found.areas) if found.areas else None,
            }
            for variant, capability in pairs
        ],
        "best": found.ranked[0][0].name,
    }
    return Document(blocks, "lrm/reach/1", values, _cells(found))


def _cells(found: VariantComparison) -> ResultTable:
    """A row for every cell that some variant reaches, with each variant's share of orientations."""
    index = np.stack([capability.index for capability in found.maps])
    some = (index > 0.0).any(axis=0)
    centres = found.maps[0].grid.centres[some] * 1e3
    shares = ("index " + variant.name.replace(",", " ") + "|.6f" for variant in found.variants)
    return ResultTable(
        ("x_mm|.3f", "y_mm|.3f", "z_mm|.3f", *shares), np.concatenate([centres.T, index[:, some]]).T.tolist()
    )
