"""Report of `identify-parameters`: singular values, and dependent parameters."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lrm_ident.data.wording import in_percent
from lrm_ident.design.observability import UNITS, Units
from lrm_ident.design.parameter_elimination import ParameterElimination
from lrm_ident.fitting.identifiability import UnidentifiableParameter
from lrm_ident.fitting.parameter_sets import TABLE_4_5
from lrm_ident.report.document import Block, Document, ResultTable, heading, section
from lrm_ident.report.fit import screen_unit
from lrm_ident.report.plain_names import symbol
from lrm_math.arrays import Array
from lrm_math.model.model import Model

ALIKE, PARTS_SHOWN, PER_LINE = 0.2, 3, 9
UNIT_WORDS = {"thesis": "mm per rad, mm or rad/Nmm", "scaled": "mm per typical size"}


def elimination_document(model: Model, found: ParameterElimination) -> Document:
    """Result of `lrm-ident identify-parameters`, schema `lrm/identifiability/1`; its figure shows singular values."""
    kept, removed = len(found.kept), list(zip(found.removals, found.held, strict=True))
    sets = {units: {"all": found.all_values[units], "kept": found.kept_values[units]} for units in UNITS}
    blocks: list[Block] = [
        heading(
            f"{found.poses} poses determine {kept} of {len(found.keys)} parameters: every singular value reaches "
            f"{found.threshold:g} ({UNIT_WORDS[found.units]})"
        )
    ]
    for units in UNITS:
        blocks += section(f"\nSingular values, {UNIT_WORDS[units]}:", _singular_values(found, units))
    symbols = ("  ".join(map(symbol, found.kept[k : k + PER_LINE])) for k in range(0, kept, PER_LINE))
    blocks += section("\nKept:", [*symbols, *_against_table_4_5(found)])
    why = (f"{removal.key}: {in_words(model, held)}" for removal, held in removed)
    blocks += section("\nTaken out, in this order, and why:", why)
    values = {
        "poses": found.poses,
        "units": found.units,
        "threshold_mm": found.threshold,
        "kept": found.kept,
        "removed": [
            {
                "parameter": removal.key,
                "least_singular_value_before_mm": removal.before,
                "least_singular_value_after_mm": removal.after,
                "survival": held.survival,
                "moves_the_tcp_like": dict(held.combination),
            }
            for removal, held in removed
        ],
        "singular_values_mm": sets,
        "observability": found.observability,
    }
    rows = [
        (units, name, number, value)
        for units in UNITS
        for name, singular_values in sets[units].items()
        for number, value in enumerate(singular_values, start=1)
    ]
    behind = ResultTable(("units", "set", "number", "singular_value_mm|.9g"), rows)
    return Document(blocks, "lrm/identifiability/1", values, behind)


def _singular_values(found: ParameterElimination, units: Units) -> Iterator[str]:
    indices = ", ".join(f"{name} {number:.3g}" for name, number in vars(found.observability[units]).items())
    yield f"all {len(found.keys)}: {_values(found.all_values[units])}"
    yield f"the {len(found.kept)} kept: {_values(found.kept_values[units])}"
    yield f"of those: {indices}"


def _against_table_4_5(found: ParameterElimination) -> list[str]:
    if not set(TABLE_4_5) <= set(found.keys):
        return []
    more = ", ".join(symbol(key) for key in found.kept if key not in TABLE_4_5)
    fewer = ", ".join(symbol(key) for key in TABLE_4_5 if key not in found.kept)
    both = [f"beyond the thesis's 28 (Table 4.5): {more}"] if more else []
    both += [f"of its 28 not kept: {fewer}"] if fewer else []
    return ["; ".join(both) or "these are the thesis's 28 (Table 4.5)"]


def in_words(model: Model, held: UnidentifiableParameter) -> str:
    """Words for an unidentifiable parameter: `δd1 moves the tip exactly like +0.87 δx_b +0.5 δz_b`."""
    name, (_, scale, unit) = symbol(held.key), screen_unit(model, held.key)
    if held.combination and held.survival <= ALIKE:
        parts = " ".join(
            f"{amount:+.3g} {_unit(model, key)} {symbol(key)}" for key, amount in held.combination[:PARTS_SHOWN]
        )
        less = " and less of others" if len(held.combination) > PARTS_SHOWN else ""
        like = "exactly" if held.survival < 1e-6 else f"but for {in_percent(held.survival)} %"
        return f"1 {_unit(model, held.key)} {name} moves the tip {like} like {parts}{less}"
    if not np.isfinite(held.standard_error):
        return f"{name} does not move the tip at all"
    return f"{name} hardly moves the tip (it would be known to ± {held.standard_error * scale:.3g} {unit})"


def _unit(model: Model, key: str) -> str:
    return model.parameter(key).unit.replace("_per_", "/")


def _values(values: Array) -> str:
    return " ".join(f"{value:.2e}" if value > 1e-9 else "0" for value in values)
