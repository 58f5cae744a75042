"""Findings that stand out in a fleet: effects and parameters that go with a tag, and arms unlike their sisters.

Tags: Fisher's exact test of an effect against a tag (Freeman & Halton 1951); of a parameter the rank test of Mann &
Whitney 1947 between two levels, exact for few arms, of Kruskal & Wallis 1952 between more; all together adjusted by
Benjamini & Yekutieli 2001. Outliers: Student's t of an arm against its sisters, who do not include it (externally
studentised residual, Cook & Weisberg 1982), corrected for all that are looked at (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr

from lrm_ident.fleet.effect_rates import EffectRate
from lrm_ident.fleet.fleet_prior import ArmEstimates
from lrm_ident.fleet.identify_arm import ArmRecord
from lrm_ident.fleet.manifest import FleetMember
from lrm_ident.residual.significance import benjamini_yekutieli
from lrm_ident.residual.thresholds import SIGNIFICANCE
from lrm_math.arrays import Array

MIN_OTHER_ARMS, FEWEST_OF_A_LEVEL = 4, 2
MOST_LEVELS = 8
DETERMINED = 1.0  # typical sizes: a standard error above it says nothing of one arm
Estimated = tuple[int, float, float]
"""Number of an arm, its estimate and standard error (typical sizes)."""


@dataclass(frozen=True)
class TagAssociation:
    """Something that goes with a tag: `what` (an effect or a parameter), its p value after adjusting for all tried, and
    for each level of the tag what is seen there."""

    what: str
    tag: str
    p_value: float
    levels: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class FleetOutlier:
    """A parameter of an arm far from its sisters': both in the unit of its key; `distance` in standard
    deviations of what a sister would show."""

    arm: str
    key: str
    value: float
    sisters: float
    sisters_sd: float
    distance: float


def tag_associations(
    members: Sequence[FleetMember],
    records: Sequence[ArmRecord],
    estimates: Sequence[ArmEstimates],
    rates: Sequence[EffectRate],
) -> tuple[TagAssociation, ...]:
    """Findings that go significantly with a tag, surest first."""
    tried: list[TagAssociation] = []
    for tag in dict.fromkeys(name for member in members for name, _ in member.tags):
        cells = [dict(member.tags).get(tag, "") for member in members]
        levels = sorted(set(cells))
        groups = [[i for i, cell in enumerate(cells) if cell == level] for level in levels]
        if not 2 <= len(levels) <= MOST_LEVELS or sum(len(group) >= FEWEST_OF_A_LEVEL for group in groups) < 2:
            continue
        named = list(zip(levels, groups, strict=True))
        tried += [*_of_effects(tag, named, records, rates), *_of_parameters(tag, named, estimates)]
    adjusted = benjamini_yekutieli({str(number): link.p_value for number, link in enumerate(tried)})
    links = [replace(link, p_value=adjusted[str(number)]) for number, link in enumerate(tried)]
    return tuple(
        sorted((link_found for link_found in links if link_found.p_value < SIGNIFICANCE), key=lambda link: link.p_value)
    )


def outliers(records: Sequence[ArmRecord], estimates: Sequence[ArmEstimates]) -> tuple[FleetOutlier, ...]:
    """Parameters of arms that are farther from their sisters' than chance puts one of all, farthest first.

    The farthest is taken out and the rest looked at again, so that one cannot hide another.
    """
    determined = {key: [row for row in rows if row[2] < DETERMINED] for key, rows in _by_key(estimates).items()}
    tests = sum(len(rows) for rows in determined.values() if len(rows) > MIN_OTHER_ARMS)
    odd = []
    for key, rows in determined.items():
        while len(rows) > MIN_OTHER_ARMS:
            distances, middles, spreads = _leave_one_out(rows)
            far = int(distances.argmax())
            if 2.0 * float(stdtr(len(rows) - 2, -distances[far])) * tests > SIGNIFICANCE:
                break
            arm, value, _ = rows.pop(far)
            scale = estimates[arm].typical_of(key)
            numbers = value * scale, float(middles[far]) * scale, float(spreads[far]) * scale
            odd.append(FleetOutlier(records[arm].name, key, *numbers, float(distances[far])))
    return tuple(sorted(odd, key=lambda outlier: -outlier.distance))


def _leave_one_out(rows: Sequence[Estimated]) -> tuple[Array, Array, Array]:
    """Studentised distance of each row (n,) from the others, their mean and their standard deviation."""
    values, errors = (np.array([row[k] for row in rows]) for k in (1, 2))
    others = len(rows) - 1
    apart = values - values.mean()
    middle = values.mean() - apart / others
    squares = (apart**2).sum() - apart**2 * (1.0 + 1.0 / others)
    spread = np.sqrt(np.maximum(squares, 0.0) / (others - 1))
    more = np.maximum(0.0, errors**2 - _medians_of_others(errors) ** 2)
    sd = np.sqrt(spread**2 * (1.0 + 1.0 / others) + more)
    return np.abs(values - middle) / np.maximum(sd, 1e-12), middle, spread


def _medians_of_others(values: Array) -> Array:
    """(n,), of each value the median of all others."""
    ranks, ordered = np.argsort(np.argsort(values)), np.sort(values)
    lower, upper = (len(values) - 2) // 2, (len(values) - 1) // 2
    below, above = (np.where(rank < ranks, ordered[rank], ordered[rank + 1]) for rank in (lower, upper))
    return np.asarray(0.5 * (below + above))


def _by_key(estimates: Sequence[ArmEstimates]) -> dict[str, list[Estimated]]:
    """Estimates of each parameter: (arm, estimate, standard error) in typical sizes."""
    by_key: dict[str, list[Estimated]] = {}
    for arm, estimate in enumerate(estimates):
        for key, value, variance in zip(estimate.keys, estimate.mean, np.diag(estimate.covariance), strict=True):
            by_key.setdefault(key, []).append((arm, float(value), float(np.sqrt(variance))))
    return by_key


def _of_effects(
    tag: str, levels: Sequence[tuple[str, list[int]]], records: Sequence[ArmRecord], rates: Sequence[EffectRate]
) -> Iterator[TagAssociation]:
    from scipy.stats import fisher_exact  # takes a second to load: not at the start of every command

    for rate in rates:
        has = np.array([any(rate.name in step for step in record.steps) for record in records])
        if has.any() and not has.all():
            counts = np.array([[int(has[group].sum()), int((~has[group]).sum())] for _, group in levels])
            p_value = float(fisher_exact(counts).pvalue)
            seen = tuple((level, f"{yes} of {yes + no}") for (level, _), (yes, no) in zip(levels, counts, strict=True))
            yield TagAssociation(rate.name, tag, p_value, seen)


def _of_parameters(
    tag: str, levels: Sequence[tuple[str, list[int]]], estimates: Sequence[ArmEstimates]
) -> Iterator[TagAssociation]:
    for key, estimates_of_key in _by_key(estimates).items():
        value = {arm: estimate for arm, estimate, error in estimates_of_key if error < DETERMINED}
        groups = [[value[arm] for arm in group if arm in value] for _, group in levels]
        full = [group for group in groups if len(group) >= FEWEST_OF_A_LEVEL]
        if len(full) >= 2 and np.ptp(np.concatenate(full)) > 0:
            scale = estimates[estimates_of_key[0][0]].typical_of(key)
            seen = ((level, group) for (level, _), group in zip(levels, groups, strict=True) if group)
            words = tuple((level, f"median {np.median(group) * scale:.3g}") for level, group in seen)
            yield TagAssociation(key, tag, _rank_test(full), words)


def _rank_test(groups: Sequence[Sequence[float]]) -> float:
    """p value of the hypothesis that all groups are of one distribution."""
    from scipy.stats import kruskal, mannwhitneyu  # a second of imports that most commands do without

    if len(groups) == 2:
        first, second = map(np.asarray, groups)
        return float(mannwhitneyu(first, second).pvalue)
    return float(kruskal(*groups).pvalue)
