"""Values of the figures of a fleet's page, as plain JSON: rounded values in the units of the screen."""

from __future__ import annotations

from collections import Counter
from typing import Any

from lrm_ident.fleet.fleet_prior import FleetKnowledge
from lrm_ident.fleet.fleet_report import FleetResult, causes_words, rate_words
from lrm_ident.fleet.identify_arm import ArmRecord
from lrm_ident.report.fit import screen_unit
from lrm_ident.report.plain_names import plain_name
from lrm_math.arm.arm import BASE
from lrm_math.effects.reference import ParameterRef


def fleet_figures(result: FleetResult) -> dict[str, Any]:
    """Arms (errors in mm, effects, tags), effects with their rates, and every parameter of every arm."""
    tags = result.tags
    arms = [
        {
            "name": record.name,
            "tags": {tag: dict(member.tags).get(tag, "") for tag in tags},
            "nominal": _rounded(record.nominal_rms_mm),
            "held_out": _rounded(record.held_out_rms_mm),
            "effects": [
                {"name": step[0], "sure": len(step) == 1, "words": causes_words(step)} for step in record.steps
            ],
        }
        for member, record in zip(result.members, result.records, strict=True)
    ]
    parameters = _parameters(result)
    return {
        "arms": arms,
        "tags": tags,
        "effects": _effects(result.records, result.known),
        "parameters": parameters,
        "first_tag": next((link.tag for link in result.links), tags[0] if tags else ""),
        "first_parameter": _first_parameter(result, [parameter["key"] for parameter in parameters]),
    }


def _effects(records: tuple[ArmRecord, ...], knowledge: FleetKnowledge | str) -> list[dict[str, str]]:
    """Every effect that some arm has, most frequent first, in how many arms, and its rate."""
    done = sum(not record.reason for record in records)
    rates = {} if isinstance(knowledge, str) else {effect_rate.name: effect_rate for effect_rate in knowledge.rates}
    count = Counter(step[0] for record in records for step in record.steps)
    out = []
    for name in sorted(count, key=lambda name_of: (-count[name_of], name_of)):
        rate = rates.get(name)
        words = f"{count[name]} of {done} arms" if rate is None else rate_words(rate)
        out.append({"name": name, "words": f"{plain_name(name)}<br>{words}"})
    return out


def _parameters(result: FleetResult) -> list[dict[str, Any]]:
    """Estimates and standard errors of every parameter, with the arms' mean and spread, for the screen."""
    place = {record.name: number for number, record in enumerate(result.records)}
    models = {key: estimate.model for estimate in result.estimates.values() for key in estimate.keys}
    common = dict[str, tuple[float, float]]()
    if not isinstance(result.known, str):
        population = result.known.population
        common = dict(zip(result.known.keys, zip(population.mean, population.spread, strict=True), strict=True))
    odd = {(outlier.key, outlier.arm) for outlier in result.outliers}
    out = []
    for key, model in models.items():
        label, scale, unit = screen_unit(model, key)
        scale *= model.parameter(key).typical
        have = [
            (name, estimate.keys.index(key), estimate)
            for name, estimate in result.estimates.items()
            if key in estimate.keys
        ]
        mean, spread = (_rounded(value * scale) for value in common[key]) if key in common else (None, None)
        out.append(
            {
                "key": key,
                "label": label,
                "unit": unit,
                "arms": [place[name] for name, _, _ in have],
                "value": [_rounded(estimate.mean[j] * scale) for _, j, estimate in have],
                "error": [_rounded(estimate.covariance[j, j] ** 0.5 * scale) for _, j, estimate in have],
                "mean": mean,
                "spread": spread,
                "outliers": [place[name] for name, _, _ in have if (key, name) in odd],
            }
        )
    return out


def _first_parameter(result: FleetResult, keys: list[str]) -> str:
    """Findings that stand out: an arm's parameter, one that goes with a tag, or the first compliance."""
    notable = (*(outlier.key for outlier in result.outliers), *(link.what for link in result.links))
    softness = (key for key in keys if (of := ParameterRef.parse(key)).id == "compliance" and of.place != BASE)
    return next((key for key in (*notable, *softness, *keys) if key in keys), "")


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")
