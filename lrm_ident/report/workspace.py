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
        return sum(capability.goals for capability in self.maps)

    @property
    def goals_per_second(self) -> float:
        """Target poses in a second, most of them out of reach."""
        return self.goals / self.seconds

    def criterion(self, capability: CapabilityMap) -> float:
        """The criterion that ranks maps: the mean index over all areas, or the volume (m³) where no area is given."""
        return capability.score(self.areas) if self.areas else capability.volume

    @property
    def ranked(self) -> list[tuple[ArmVariant, CapabilityMap]]:
        """Best first."""
        pairs = zip(self.variants, self.maps, strict=True)
        return sorted(pairs, key=lambda pair: self.criterion(pair[1]), reverse=True)


def reach_document(comparison: VariantComparison) -> Document:
    """Result of `lrm-ident reach`, schema `lrm/reach/1`: the variants, best first, and the speed of the solver."""
    grid, pairs = comparison.maps[0].grid, list(zip(comparison.variants, comparison.maps, strict=True))
    clear = "clear of collisions" if comparison.collisions else "collisions not looked at"
    total = comparison.areas if len(comparison.areas) > 1 else ()
    columns = ["variant", "volume L|.1f", "index %|.2f", *(f"{area.name} %|.2f" for area in comparison.areas)]
    rows = []
    for variant, capability in comparison.ranked:
        shares = [capability.everywhere.index, *(capability.within(area).index for area in comparison.areas)]
        shares += [capability.score(total)] if total else []
        rows.append((variant.name, capability.volume * 1e3, *(100 * share for share in shares)))
    blocks: list[Block] = [
        heading(f"{len(grid)} cells of {grid.step * 1e3:g} mm, {comparison.orientations} orientations each, {clear}"),
        ResultTable([*columns, "all areas %|.2f"] if total else columns, rows),
        Text(INDEX_MEANING, style="dim"),
        f"{comparison.goals:,} goals in {comparison.seconds:.1f} s: {comparison.goals_per_second:,.0f} goals/s",
    ]
    values = {
        "arm": comparison.variants[0].arm.name,
        "step_mm": grid.step * 1e3,
        "cells": len(grid),
        "orientations": comparison.orientations,
        "collisions": comparison.collisions,
        "goals": comparison.goals,
        "seconds": comparison.seconds,
        "goals_per_s": comparison.goals_per_second,
        "areas": {
            area.name: {"from_mm": 1e3 * np.array(area.low), "to_mm": 1e3 * np.array(area.high)}
            for area in comparison.areas
        },
        "variants": [
            {
                "name": variant.name,
                "volume_l": capability.volume * 1e3,
                "reachable": capability.everywhere,
                "areas": {area.name: capability.within(area) for area in comparison.areas},
                "all_areas_index": capability.score(comparison.areas) if comparison.areas else None,
            }
            for variant, capability in pairs
        ],
        "best": comparison.ranked[0][0].name,
    }
    return Document(blocks, "lrm/reach/1", values, _cells(comparison))


def _cells(comparison: VariantComparison) -> ResultTable:
    """A row for every cell that some variant reaches, with each variant's share of orientations."""
    index = np.stack([capability.index for capability in comparison.maps])
    some = (index > 0.0).any(axis=0)
    centres = comparison.maps[0].grid.centres[some] * 1e3
    shares = ("index " + variant.name.replace(",", " ") + "|.6f" for variant in comparison.variants)
    return ResultTable(
        ("x_mm|.3f", "y_mm|.3f", "z_mm|.3f", *shares), np.concatenate([centres.T, index[:, some]]).T.tolist()
    )
