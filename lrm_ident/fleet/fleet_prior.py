"""The prior that a fleet makes for its next arm: population and effect rates of all arms, as a prior file.

Mean and covariance of all parameters (the spreads between arms, and what is not known of the means), the
part of the arms that has each effect, and the intervals of all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS
from lrm_ident.fitting.priors import WEAK_SD, EffectRateTable, GaussianTable, PriorFile
from lrm_ident.fleet.effect_rates import EffectRate, effect_rates
from lrm_ident.fleet.identify_arm import ArmRecord
from lrm_ident.fleet.population import ArmEvidence, Population, fit_population
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import EffectRef
from lrm_math.errors import LrmError
from lrm_math.model.covariance import covariance_table, to_covariance
from lrm_math.model.model import Model
from lrm_math.model.model_file import ModelFile, to_model

FEWEST_ARMS = 3
RARE = 0.005  # rate below which an effect that no arm has is not listed
DIGITS = 6


@dataclass(frozen=True, eq=False)
class ArmEstimates:
    """Estimates of one arm's file.

    Attributes:
        model: with the estimates as values. keys: (P,), of those in `covariance` (P, P), typical sizes squared.
        mean: (P,), typical sizes. Both with the weak prior.
    """

    model: Model
    keys: tuple[str, ...]
    mean: Array
    covariance: Array

    def typical_of(self, key: str) -> float:
        """Typical size of a parameter, in the unit of its key."""
        parameter = self.model.parameter(key)
        return parameter.typical / parameter.si


@dataclass(frozen=True, eq=False)
class FleetKnowledge:
    """Prior of a fleet: `population` of the parameters `keys` (Q,), whose typical sizes are `typical` (Q,) in the
    units of the keys, and `rates`."""

    keys: tuple[str, ...]
    typical: Array
    population: Population
    rates: tuple[EffectRate, ...]
    arms: int


def arm_estimates(name: str, evidence: ModelFile, arm: Arm) -> ArmEstimates:
    """An arm's estimates with the weak prior. Raises `LrmError`.

    Args:
        evidence: of the arm called `name` (`evidence_of`). arm: the description that the evidence names.
    """
    model = to_model(Path(name), evidence, arm)
    if evidence.covariance is None:
        raise LrmError(f"{name}: the fit has no covariance")
    covariance = to_covariance(evidence.covariance, evidence.sigma, model)
    typical = np.array([model.parameter(key).typical for key in covariance.keys])
    mean = np.array([model.value(key) for key in covariance.keys]) / typical
    return ArmEstimates(model, covariance.keys, mean, covariance.matrix / np.outer(typical, typical))


def fleet_knowledge(records: Sequence[ArmRecord], estimates: Sequence[ArmEstimates]) -> FleetKnowledge:
    """Population and rates of arms of one kind. Raises `LrmError`: fewer than three arms.

    Parameters of an effect are those of the arms that have it.
    """
    if len(records) < FEWEST_ARMS:
        raise LrmError(f"{len(records)} arms determine no spread; a fleet's prior needs at least {FEWEST_ARMS}")
    keys = tuple(dict.fromkeys(key for estimate in estimates for key in estimate.keys))
    by_key = {key: estimate.typical_of(key) for estimate in estimates for key in estimate.keys}
    place = {key: number for number, key in enumerate(keys)}
    evidence = [arm_evidence(estimate, place) for estimate in estimates]
    every = effect_rates([record.steps for record in records], [record.tested for record in records])
    rates = tuple(effect_rate for effect_rate in every if EffectRef.parse(effect_rate.name).id not in DEFAULT_EFFECTS)
    typical = np.array([by_key[key] for key in keys])
    return FleetKnowledge(keys, typical, fit_population(evidence, len(keys)), rates, len(records))


def arm_evidence(estimates: ArmEstimates, place: dict[str, int]) -> ArmEvidence:
    """Information of the arm's poses alone: the weak prior taken away from the posterior."""
    posterior = np.linalg.inv(estimates.covariance)
    information = posterior - np.eye(len(estimates.keys)) / WEAK_SD**2
    sizes, directions = np.linalg.eigh(0.5 * (information + information.T))
    information = (directions * np.maximum(sizes, 0.0)) @ directions.T
    return ArmEvidence(np.array([place[key] for key in estimates.keys]), information, posterior @ estimates.mean)


def prior_text(knowledge: FleetKnowledge, name: str, source: str) -> str:
    """The prior file, schema `lrm/prior/1`, as TOML text."""
    return tomli_w.dumps(prior_file(knowledge, name, source).model_dump(by_alias=True, exclude_none=True))


def parameter_values(knowledge: FleetKnowledge) -> dict[str, dict[str, Any]]:
    """Mean and spread of every parameter with their intervals, in the unit of its key, and how many arms have it."""
    population, scale = knowledge.population, knowledge.typical
    return {
        key: {
            "mean": float(population.mean[j] * scale[j]),
            "mean_interval": [float(side[j] * scale[j]) for side in population.mean_interval],
            "spread": float(population.spread[j] * scale[j]),
            "spread_interval": [float(side[j] * scale[j]) for side in population.spread_interval],
            "arms": int(population.arms[j]),
        }
        for j, key in enumerate(knowledge.keys)
    }


def prior_file(knowledge: FleetKnowledge, name: str, source: str) -> PriorFile:
    """The prior of a fleet's next arm."""
    covariance = knowledge.population.predictive_covariance
    sds = np.sqrt(np.diag(covariance)) * knowledge.typical
    parameters = {
        key: GaussianTable(sd=_rounded(sd), **{field: _rounded(value) for field, value in values.items()})
        for (key, values), sd in zip(parameter_values(knowledge).items(), sds, strict=True)
    }
    listed = [effect_rate for effect_rate in knowledge.rates if effect_rate.found > 0 or effect_rate.rate > RARE]
    others = [effect_rate.rate for effect_rate in knowledge.rates if effect_rate not in listed]
    return PriorFile(
        schema="lrm/prior/1",
        name=name,
        source=source,
        parameters=parameters,
        covariance=covariance_table(knowledge.keys, covariance),
        effects={
            effect_rate.name: EffectRateTable(
                rate=_rounded(effect_rate.rate),
                interval=[_rounded(effect_rate.low), _rounded(effect_rate.high)],
                found=round(effect_rate.found, 3),
                arms=effect_rate.arms,
            )
            for effect_rate in listed
        },
        other_rate=_rounded(max(others)) if others else None,
    )


def _rounded(value: Any) -> Any:
    """Numbers with as many digits as a prior file has; counts as they are."""
    if isinstance(value, list):
        return list(map(_rounded, value))
    return value if isinstance(value, int) else float(f"{value:.{DIGITS}g}")
