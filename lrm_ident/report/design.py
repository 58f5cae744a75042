"""What people and machines read of chosen poses and of designs."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.console import Console

from lrm_ident.data.csv_table import table_text
from lrm_ident.data.measurements import Measurements
from lrm_ident.design.discrimination import LEVEL, SURE, Rival, Separation
from lrm_ident.design.observability import INDICES, Observability
from lrm_ident.design.pose_design import Design, Knowledge, Offer, Task
from lrm_ident.design.pose_selection import Choice, Identified
from lrm_ident.report.fit import table
from lrm_ident.report.symbols import symbol
from lrm_math.effects import Effect
from lrm_math.model.model import Model

WORST_SHOWN = 8


def print_choice(console: Console, model: Model, found: Choice, data: Measurements) -> None:
    """The result of `lrm-ident choose-poses`."""
    n, best = len(found.rows), found.best_possible_o1
    console.print(_index_table(f"{n} of {len(data)} poses, {len(model.free)} parameters", found.value, found.blind))
    console.print(
        f"O1 reaches {100 * found.value.O1 / best:.1f} % of {best:.4g}, which no {n} of these poses can exceed.",
        highlight=False,
    )
    errors = table("Identified on them", "", ">mean mm, all", ">RMS mm, all", ">mean mm, the rest", "against physics")
    for one in found.identified:
        rest = "–" if one.on_rest is None else f"{one.on_rest.mean * 1e3:.2f}"
        against = ", ".join(f"{symbol(key)} = {one.fit.model.value(key):.3g}" for key in one.broken) or "nothing"
        errors.add_row(one.name, f"{one.on_all.mean * 1e3:.2f}", f"{one.on_all.rms * 1e3:.2f}", rest, against)
    console.print(errors)
    numbers = " ".join(str(number) for number in data.pose[found.rows])
    console.print(f"Poses: {numbers}", highlight=False, soft_wrap=True)


def _index_table(title: str, value: Observability, blind: Observability) -> Any:
    out = table(title, "columns: mm per typical size", *(f">{name}" for name in INDICES))
    out.add_row("chosen", *(f"{value.value(name):.4g}" for name in INDICES))
    out.add_row("drawn blindly (median)", *(f"{blind.value(name):.4g}" for name in INDICES))
    return out


def choice_json(found: Choice, data: Measurements) -> dict[str, Any]:
    """Schema `lrm/choice/1`."""
    return {
        "schema": "lrm/choice/1",
        "poses": data.pose[found.rows].tolist(),
        "observability": vars(found.value),
        "drawn_blindly": vars(found.blind),
        "o1_no_choice_exceeds": found.best_possible_o1,
        "identified": [_identified_json(one) for one in found.identified],
    }


def _identified_json(one: Identified) -> dict[str, Any]:
    return {
        "how": one.name,
        "error_all": one.on_all.as_json(),
        "error_rest": None if one.on_rest is None else one.on_rest.as_json(),
        "against_physics": list(one.broken),
        "at_bound": list(one.fit.at_bound),
    }


def choice_rows(found: Choice, data: Measurements) -> str:
    """CSV: every pose, whether it is chosen, and where its TCP is."""
    chosen = np.isin(np.arange(len(data)), found.rows)
    columns = [("pose", data.pose.astype(np.float64), 0), ("chosen", chosen.astype(np.float64), 0)]
    return table_text([*columns, *((f"{axis}_mm", data.tcp[:, i] * 1e3, 4) for i, axis in enumerate("xyz"))])


def print_design(console: Console, task: Task, offer: Offer, found: Design) -> None:
    """The result of `lrm-ident design`."""
    twice = len(found.poses) - len(found.rows)
    console.print(f"Candidates: {offer.words}.", highlight=False, soft_wrap=True)
    for rule, count in offer.refused.items():
        if count:
            console.print(f"  refused: {count} with {rule}", highlight=False)
    console.print(_index_table(f"{len(found.rows)} poses, {len(found.keys)} parameters", found.index, found.blind))
    console.print(_error_table(found))
    for line in gain_lines(task, found):
        console.print(line, highlight=False, soft_wrap=True)
    console.print(
        f"To measure: {len(found.poses)} poses, {twice} of them again (repeat_of), in random order; come to each from "
        "the side in the column approach: +1 from smaller angles, -1 from larger ones, every joint.",
        highlight=False,
        soft_wrap=True,
    )


def _error_table(found: Design) -> Any:
    """The parameters that stay least known, as motion of the TCP."""
    before = [] if found.before is None else [">now"]
    title = "Least known: expected standard errors"
    out = table(title, "parameter (mm of TCP motion)", *before, ">with these", ">with blind ones")
    for j in np.argsort(-found.after.errors)[:WORST_SHOWN]:
        now = [] if found.before is None else [f"{found.before.errors[j]:.3f}"]
        out.add_row(found.keys[j], *now, f"{found.after.errors[j]:.3f}", f"{found.blind_after.errors[j]:.3f}")
    return out


def gain_lines(task: Task, found: Design) -> list[str]:
    """What the poses will tell, one sentence each."""
    now = "" if found.before is None else f"{found.before.tcp:.3g} mm now, "
    lines = [
        f"The TCP would be predicted to {found.after.tcp:.3g} mm RMS anywhere among the candidates ({now}"
        f"{found.blind_after.tcp:.3g} mm with poses drawn blindly), as far as the parameters go, with noise of "
        f"{task.noise * 1e3:g} mm per axis."
    ]
    if found.after.apart is None or found.blind_after.apart is None:
        return lines
    was = None if found.before is None else found.before.apart
    apart, blind = found.after.apart, found.blind_after.apart
    if len(apart.rivals) > 1:
        first, second = apart.rivals[0].name, apart.rivals[1].name
        earlier = "" if was is None else f"{was.cosine:.2f} now, "
        lines.append(
            f"{first} and {second} would look alike to a cosine of {apart.cosine:.2f} "
            f"({earlier}{blind.cosine:.2f} with blind ones; 1: the same)."
        )
    for k, effect in enumerate(task.rivals):
        earlier = "" if was is None else f"; now {_least(effect, was, k)}"
        lines.append(
            f"{apart.rivals[k].name} would be told from everything else in {100 * SURE:.0f} % of cases "
            f"{_least(effect, apart, k)} (with blind ones {_least(effect, blind, k)}{earlier}); "
            f"{_errors(apart.rivals[k])}."
        )
    return lines


def _least(effect: Effect, apart: Separation, k: int) -> str:
    least = apart.rivals[k].least
    if least is None:
        return "never"
    sizes = [f"{p.name} = {least * p.typical / p.si:.2g}" for p in effect.parameters if p.fixed is None]
    return f"from {' and '.join(sizes)} on"


def _errors(rival: Rival) -> str:
    if not rival.errors:
        return "it cannot be told"
    return "expected standard errors " + ", ".join(f"{name} ± {error:.2g}" for name, error in rival.errors)


def design_csv(found: Design) -> str:
    """The pose file, in the order to measure."""
    q = np.degrees(found.poses.q)
    side = np.zeros(len(q)) if found.poses.direction is None else found.poses.direction[:, 0]
    return table_text(
        [
            ("pose", found.number.astype(np.float64), 0),
            *((f"q{i + 1}_deg", q[:, i], 6) for i in range(q.shape[1])),
            ("payload_g", found.poses.payload * 1e3, 3),
            ("approach", side, 0),
            ("repeat_of", found.repeat_of.astype(np.float64), 0),
        ]
    )


def design_json(task: Task, offer: Offer, found: Design) -> dict[str, Any]:
    """Schema `lrm/design/1`."""
    return {
        "schema": "lrm/design/1",
        "candidates": len(offer.poses),
        "candidates_in_words": offer.words,
        "refused": offer.refused,
        "poses": len(found.rows),
        "repeats": len(found.poses) - len(found.rows),
        "noise_mm": task.noise * 1e3,
        "parameters": list(found.keys),
        "observability": vars(found.index),
        "drawn_blindly": vars(found.blind),
        "now": None if found.before is None else _knowledge_json(found, found.before),
        "with_these": _knowledge_json(found, found.after),
        "with_blind_ones": _knowledge_json(found, found.blind_after),
        "in_words": gain_lines(task, found),
    }


def _knowledge_json(found: Design, known: Knowledge) -> dict[str, Any]:
    out: dict[str, Any] = {
        "tcp_rms_mm": known.tcp,
        "standard_error_as_tcp_motion_mm": dict(zip(found.keys, known.errors.tolist(), strict=True)),
    }
    if known.apart is not None:
        out["cosine"] = known.apart.cosine
        out["separate"] = [
            {
                "effect": rival.name,
                "standard_errors": dict(rival.errors),
                "power_at_typical_size": rival.power,
                "test_level": LEVEL,
                "found_from_typical_sizes": rival.least,
            }
            for rival in known.apart.rivals
        ]
    return out


def knowledge_rows(found: Design) -> str:
    """CSV: expected standard errors as motion of the TCP (mm), and least sizes of rivals (typical sizes).

    A cell is empty where a rival can never be told.
    """
    named = [("now", found.before), ("with_these", found.after), ("with_blind_ones", found.blind_after)]
    known = [(name, knowledge) for name, knowledge in named if knowledge is not None]
    lines = ["what,unit," + ",".join(name for name, _ in known)]
    for j, key in enumerate(found.keys):
        lines.append(f"{key},mm," + ",".join(f"{knowledge.errors[j]:.6g}" for _, knowledge in known))
    for k in range(0 if found.after.apart is None else len(found.after.apart.rivals)):
        rivals = [knowledge.apart.rivals[k] for _, knowledge in known if knowledge.apart is not None]
        cells = ["" if rival.least is None else f"{rival.least:.6g}" for rival in rivals]
        lines.append(f"{rivals[0].name},typical sizes," + ",".join(cells))
    return "\n".join(lines) + "\n"
