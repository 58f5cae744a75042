"""What people and machines read of identifiability and of step sizes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import Console

from lrm_ident.design.finite_difference_study import GOOD, StepStudy
from lrm_ident.design.observability import UNITS
from lrm_ident.design.parameter_elimination import Elimination
from lrm_ident.fit.identifiability import Unidentifiable
from lrm_ident.fit.parameter_sets import TABLE_4_5
from lrm_ident.report.fit import screen_unit, table
from lrm_ident.report.symbols import symbol
from lrm_math.model.model import Model

ALIKE, PARTS_SHOWN, PER_LINE = 0.2, 3, 9
UNIT_WORDS = {"thesis": "mm per rad, mm or rad/Nmm", "scaled": "mm per typical size"}


def print_elimination(console: Console, model: Model, found: Elimination) -> None:
    """The result of `lrm-ident identify-parameters`."""
    kept = len(found.kept)
    console.print(
        f"{found.poses} poses tell {kept} of {len(found.keys)} parameters: every singular value reaches "
        f"{found.threshold:g} ({UNIT_WORDS[found.units]})",
        style="bold",
        highlight=False,
    )
    for units in UNITS:
        console.print(f"\nSingular values, {UNIT_WORDS[units]}:", style="bold")
        console.print(f"  all {len(found.keys)}: {_values(found.all_values[units])}", highlight=False, soft_wrap=True)
        console.print(f"  the {kept} kept: {_values(found.kept_values[units])}", highlight=False, soft_wrap=True)
        value = found.observability[units]
        figures = ", ".join(f"{name} {number:.3g}" for name, number in vars(value).items())
        console.print(f"  of those: {figures}", highlight=False, soft_wrap=True)
    console.print("\nKept:", style="bold")
    for k in range(0, kept, PER_LINE):
        console.print("  " + "  ".join(symbol(key) for key in found.kept[k : k + PER_LINE]), highlight=False)
    _print_against_table_4_5(console, found)
    if found.removals:
        console.print("\nTaken out, in this order, and why:", style="bold")
    for removal, held in zip(found.removals, found.held, strict=True):
        console.print(f"  {removal.key}: {in_words(model, held)}", highlight=False, soft_wrap=True)


def _print_against_table_4_5(console: Console, found: Elimination) -> None:
    if not set(TABLE_4_5) <= set(found.keys):
        return
    more = [symbol(key) for key in found.kept if key not in TABLE_4_5]
    fewer = [symbol(key) for key in TABLE_4_5 if key not in found.kept]
    both = [f"beyond the thesis's 28 (Table 4.5): {', '.join(more)}"] if more else []
    both += [f"of its 28 not kept: {', '.join(fewer)}"] if fewer else []
    console.print("  " + ("; ".join(both) or "these are the thesis's 28 (Table 4.5)"), highlight=False, soft_wrap=True)


def in_words(model: Model, held: Unidentifiable) -> str:
    """What a parameter that cannot be told amounts to: `δd1 moves the tip exactly like +0.87 δx_b +0.5 δz_b`."""
    name = symbol(held.key)
    if held.combination and held.survival <= ALIKE:
        unit = _unit(model, held.key)
        parts = " ".join(f"{amount:+.3g} {_unit(model, key)} {symbol(key)}" for key, amount in _strongest(held))
        less = " and less of others" if len(held.combination) > PARTS_SHOWN else ""
        like = "exactly" if held.survival < 1e-6 else f"but for {100 * held.survival:.0f} %"
        return f"1 {unit} {name} moves the tip {like} like {parts}{less}"
    if not np.isfinite(held.standard_error):
        return f"{name} does not move the tip at all"
    scale, unit = screen_unit(model, held.key)
    return f"{name} hardly moves the tip (it would be known to ± {held.standard_error * scale:.3g} {unit})"


def _strongest(held: Unidentifiable) -> tuple[tuple[str, float], ...]:
    return held.combination[:PARTS_SHOWN]


def _unit(model: Model, key: str) -> str:
    return model.parameters[model.position(key)].unit.replace("_per_", "/")


def _values(values: Sequence[float] | np.ndarray[Any, Any]) -> str:
    return " ".join(f"{value:.2e}" if value > 1e-9 else "0" for value in values)


def elimination_json(found: Elimination) -> dict[str, Any]:
    """Schema `lrm/identifiability/1`."""
    return {
        "schema": "lrm/identifiability/1",
        "poses": found.poses,
        "units": found.units,
        "threshold_mm": found.threshold,
        "kept": list(found.kept),
        "removed": [
            {
                "parameter": removal.key,
                "least_singular_value_before_mm": removal.before,
                "least_singular_value_after_mm": removal.after,
                "survival": held.survival,
                "moves_the_tcp_like": dict(held.combination),
            }
            for removal, held in zip(found.removals, found.held, strict=True)
        ],
        "singular_values_mm": {
            units: {"all": found.all_values[units].tolist(), "kept": found.kept_values[units].tolist()}
            for units in UNITS
        },
        "observability": {units: vars(found.observability[units]) for units in UNITS},
    }


def elimination_rows(found: Elimination) -> str:
    """CSV: the singular values, before and after, in both units."""
    lines = ["units,set,number,singular_value_mm"]
    for units in UNITS:
        for name, values in (("all", found.all_values[units]), ("kept", found.kept_values[units])):
            lines += [f"{units},{name},{number},{value:.9g}" for number, value in enumerate(values.tolist(), start=1)]
    return "\n".join(lines) + "\n"


def print_steps(console: Console, studies: Sequence[StepStudy], units: str) -> None:
    """The result of `lrm-ident step-size`."""
    words = "rad, mm, rad/Nmm" if units == "thesis" else "typical sizes"
    good = f"error < {GOOD:g} from … to"
    out = table(
        f"Central differences, steps in {words}", "joints at", "parameters", ">norm", ">best step", ">error", f">{good}"
    )
    for study in studies:
        step, error = study.best
        span = "never" if study.good is None else "{:.0e} … {:.0e}".format(*study.good)
        angle = f"{np.degrees(study.angle):.0f} deg"
        out.add_row(angle, study.option, f"{study.exact:.4g}", f"{step:.0e}", f"{error:.0e}", span)
    console.print(out)
    spans = [study.good for study in studies]
    both = [span for span in spans if span is not None]
    low, high = max((span[0] for span in both), default=np.inf), min((span[1] for span in both), default=0.0)
    if len(both) == len(spans) and low <= high:
        console.print(f"One step for all of them: {low:.0e} to {high:.0e}.", highlight=False)
    else:
        console.print("No one step is good for all of them.", highlight=False)
    collapsed = min((step for study in studies for step in study.collapsed), default=None)
    if collapsed is not None:
        console.print(f"From {collapsed:.0e} on the arm collapses: a compliance that large has no equilibrium.")


def steps_json(studies: Sequence[StepStudy], units: str) -> dict[str, Any]:
    """Schema `lrm/step-size/1`."""
    return {
        "schema": "lrm/step-size/1",
        "units": units,
        "studies": [
            {
                "joints_deg": round(float(np.degrees(study.angle)), 9),
                "parameters": study.option,
                "exact_norm": study.exact,
                "best_step": study.best[0],
                "best_relative_error": study.best[1],
                "good_steps": None if study.good is None else list(study.good),
                "steps": study.steps.tolist(),
                "norm": study.norm.tolist(),
                "relative_error": study.error.tolist(),
            }
            for study in studies
        ],
    }


def steps_rows(studies: Sequence[StepStudy]) -> str:
    """CSV: norm and error by step."""
    lines = ["joints_deg,parameters,step,norm,relative_error"]
    for study in studies:
        for step, norm, error in zip(study.steps, study.norm, study.error, strict=True):
            lines.append(f"{np.degrees(study.angle):g},{study.option},{step:.6g},{norm:.12g},{error:.6g}")
    return "\n".join(lines) + "\n"
