"""Rates of effects among arms of a kind: beta-binomial model (Skellam 1948), its two numbers from the fleet itself.

A step of `auto` may stand for several causes that one arm's data cannot tell apart; it counts for them in proportion to
how often each is there (expectation-maximisation).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import betaincinv, betaln

from lrm_math.arrays import Array

ROUNDS = 50
LEVEL = 0.95
FEWEST = 1.0
"""Arms' worth of belief that the fitted Beta distribution has at least: with few arms its likelihood is flat."""


@dataclass(frozen=True)
class EffectRate:
    """Rate of an effect.

    Attributes:
        found: arms that have it, shares of unsure ones among them. arms: that could show it.
        rate: posterior mean of the part of the kind that has it, which takes part in what is known of all effects.
        low, high: 95 % interval of that part by the count alone (Clopper & Pearson 1934), which holds found / arms.
    """

    name: str
    found: float
    arms: int
    rate: float
    low: float
    high: float


def effect_rates(steps: Sequence[Sequence[Sequence[str]]], tested: Sequence[Sequence[str]]) -> tuple[EffectRate, ...]:
    """Rates of all effects that some arm could show, most frequent first.

    Args:
        steps: for each arm, its steps, each with the names (`effect@place`) that it can stand for.
        tested: for each arm, the names that its poses could show.
    """
    names = sorted({name for effects_of_arm in tested for name in effects_of_arm})
    arms = {name: sum(name in effects_of_arm for effects_of_arm in tested) for name in names}
    if not names:
        return ()
    rate = dict.fromkeys(names, 0.5)
    expected_count = dict.fromkeys(names, 0.0)
    for _ in range(ROUNDS):
        expected_count = _counted(steps, rate)
        a, b = _beta(np.array([expected_count[name] for name in names]), np.array([arms[name] for name in names]))
        rate = {name: (expected_count[name] + a) / (arms[name] + a + b) for name in names}
    rates = (
        EffectRate(n, expected_count[n], arms[n], rate[n], *exact_interval(expected_count[n], arms[n])) for n in names
    )
    return tuple(sorted(rates, key=lambda effect_rate: (-effect_rate.rate, effect_rate.name)))


def _counted(steps: Sequence[Sequence[Sequence[str]]], rate: Mapping[str, float]) -> dict[str, float]:
    """Arms that have each effect; of one arm at most one each."""
    counts = dict.fromkeys(rate, 0.0)
    for arm in steps:
        likelihood: dict[str, float] = {}
        for names in arm:
            rated = [name for name in names if name in rate]
            whole = sum(rate[name] for name in rated)
            for name in rated:
                likelihood[name] = min(1.0, likelihood.get(name, 0.0) + rate[name] / whole)
        for name, share in likelihood.items():
            counts[name] += share
    return counts


def _beta(counted: Array, arms: Array) -> tuple[float, float]:
    """The Beta distribution of the rates that makes the counts most likely."""

    def surprise(logs: Array) -> float:
        a, b = np.exp(logs)
        return -float((betaln(counted + a, arms - counted + b) - betaln(a, b)).sum())

    best = minimize(surprise, np.log([0.1, 1.0]), method="L-BFGS-B", bounds=[(-7.0, 3.0), (-3.0, 7.0)]).x
    a, b = (float(value) for value in np.exp(best))
    scale = max(1.0, FEWEST / (a + b))
    return a * scale, b * scale


def exact_interval(counted: float, arms: int) -> tuple[float, float]:
    """Exact 95 % interval of a share (Clopper & Pearson 1934) where `counted` of `arms` have it; parts of arms, too."""
    tails = (1 - LEVEL) / 2, (1 + LEVEL) / 2
    low = float(betaincinv(counted, arms - counted + 1, tails[0])) if counted > 0 else 0.0
    return low, float(betaincinv(counted + 1, arms - counted, tails[1])) if counted < arms else 1.0
