"""Explanation of effects, as `effects` prints it, and of where one that names no cause speaks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from rich.text import Text

from lrm_ident.data.error_stats import error_stats
from lrm_ident.report.document import Block, ResultTable, heading
from lrm_ident.residual.error_breakdown import ModelComparison
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import NOT_A_CAUSE, Effect, EffectRef, Parameter, marked
from lrm_math.effects.field.residual_field import ResidualField
from lrm_math.effects.targets import Kind, kind_of, slot_of
from lrm_math.model.deployed_model import OnRover, on_rover

MOST_PARAMETERS = 24
EXAMPLE_ARMS = ("so101", "lrm-rover")
"""The first on which an effect can act serves: `quantisation` needs the table of every servo."""
WHAT_A_FIELD_IS = f"{NOT_A_CAUSE}: a smooth function of the joint angles that predicts better, and explains nothing"
ON_ROVER = {
    OnRover.COMPENSATED: "compensated at every pose",
    OnRover.ROUNDED: "not compensated: commands are rounded so, and the distance that is left is stated",
    OnRover.WARMING: "compensated where the time since power-on is known, else as in the session",
    OnRover.REMEMBERED: "compensated where it is known what the arm did before, else as in the session",
    OnRover.CARRIED: "not compensated: stays as at the end of the session, or as on average",
    OnRover.LEFT_OUT: "left out, since it is an error of the measurement",
}
"""Treatment of an effect by the rover."""


def listed(command: str, title: str, names: Sequence[str]) -> Iterator[Block]:
    """Names in a few lines, and the command that explains one of them."""
    yield heading(f"{title}, each explained by {command}; all of them with --all:")
    yield f"  {', '.join(map(marked, names))}"


def effect_blocks(kind: type[Effect], in_full: bool) -> Iterator[Block]:
    """Explanation of one effect; in full, with source, places and parameters."""
    yield Text.assemble((marked(kind.id), "bold"), f": {kind.about.cause}")
    yield f"    {kind.about.formula}"
    if kind.variant_of:
        plain = dict.fromkeys(EffectRef.parse(name).id for name in kind.variant_of)
        yield f"    another form of {' and '.join(plain)}, fitted beside it"
    if in_full:
        yield f"    source: {kind.about.source}"
        yield f"    needs: {kind.about.needs or 'nothing special'}"
        arms = map(load_arm, EXAMPLE_ARMS)
        arm = next((candidate for candidate in arms if kind.places(candidate)), None)
        if arm is None:
            yield f"    places: none on {' or '.join(EXAMPLE_ARMS)}"
            return
        yield from _on_rover([kind(arm, place) for place in kind.places(arm)])
        effect = kind(arm, kind.places(arm)[0])
        yield f"    places, for example on {arm.name}: {', '.join(kind.places(arm))}"
        yield f"    acts on: {_acts_on(effect)}"
        yield f"    parameters, for instance at {effect.place}:"
        yield from (f"      {_parameter(parameter)}" for parameter in effect.parameters[:MOST_PARAMETERS])
        if len(effect.parameters) > MOST_PARAMETERS:
            yield f"      and {len(effect.parameters) - MOST_PARAMETERS} more"


def _on_rover(effects: Sequence[Effect]) -> Iterator[str]:
    """Treatment of an effect by the rover, at each place where that differs."""
    places: dict[OnRover, list[str]] = {}
    for effect in effects:
        places.setdefault(on_rover(effect), []).append(effect.place)
    for treatment, at in places.items():
        where = "" if len(places) == 1 else f" at {', '.join(at)}"
        yield f"    on the arm{where}: {ON_ROVER[treatment]}"


def _acts_on(effect: Effect) -> str:
    """The motions it causes, or the other hook that it uses, at one place."""
    on = ", ".join(map(slot_of, effect.targets))
    acts = {
        Kind.MOTION: f"turns or shifts {on}",
        Kind.LOAD: f"loads {on}",
        Kind.WEIGHT: "changes the weight of a body",
        Kind.GRAVITY: "turns gravity",
        Kind.FRAME: "what the tracker sees",
        Kind.ANCHOR: "where distances are measured from",
    }[kind_of(effect)]
    return f"{acts}; depends on the load on {', '.join(effect.load_slots)}" if effect.load_slots else acts


def _parameter(parameter: Parameter) -> str:
    typical = f"typically {parameter.typical / parameter.si:g}"
    bounds = f", at least {parameter.lower / parameter.si:g}" if np.isfinite(parameter.lower) else ""
    shape = "" if parameter.fixed is None else ", a shape: searched, not fitted"
    return f"{parameter.name}: {parameter.meaning} ({typical}{bounds}{shape})"


def field_blocks(comparison: ModelComparison, field: ResidualField) -> Iterator[Block]:
    """Errors of a model where its residual field speaks and where not; the angles that it was learned at, per joint."""
    model, title = comparison.equilibrium.model, f"Where {marked(field.name)} speaks"
    if comparison.speaks is None:
        yield f"{title}: not known, since the model file has no covariance"
    else:
        groups = (("the data determine it", comparison.speaks), ("it says nothing, or little", ~comparison.speaks))
        errors = [
            (words, int(rows.sum()), error_stats(comparison.residual[rows])) for words, rows in groups if rows.any()
        ]
        rows = [(words, count, error.mean * 1e3, error.rms * 1e3) for words, count, error in errors]
        yield ResultTable(("where", "poses|", "mean mm|.2f", "RMS mm|.2f"), rows, title)
    ends = zip(model.arm.joints, np.degrees(field.over(model.within).ends).tolist(), strict=True)
    reach = [
        (f"joint {number}", low, high, *np.degrees((joint.lower, joint.upper)).tolist())
        for number, (joint, (low, high)) in enumerate(ends, start=1)
    ]
    columns = ("joint", "from deg|.0f", "to deg|.0f", "lower limit deg|.0f", "upper limit deg|.0f")
    yield ResultTable(columns, reach, "It was learned between these angles; beyond, it fades to zero")


def field_values(comparison: ModelComparison, field: ResidualField) -> dict[str, object]:
    """The same for JSON, with the numbers of the poses where it does not speak."""
    silent = None if comparison.speaks is None else comparison.data.pose[~comparison.speaks].tolist()
    return {"effect": field.name, "names_a_cause": field.names_a_cause, "does_not_speak_at": silent}
