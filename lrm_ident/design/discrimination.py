"""How well a set of poses tells rival effects apart: with the fitted parameters and the other rivals fitted too.

For rival k with columns C_k, S_k is its information, everything else projected out. If the effect is there with its
typical size, the F test of it has the noncentrality θᵀS_kθ/σ², here for the mix θ of its parameters that shows least;
from it follows the power of the test (Atkinson 1972 for designs that separate rival models).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import f as f_distribution
from scipy.stats import ncf

from lrm_ident.design.observability import MM_PER_M
from lrm_ident.diagnosis.candidates import Candidate, candidates
from lrm_ident.diagnosis.linearised_fit import coincidence
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.effects.base import Evidence
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.model import Model

LEVEL, SURE = 0.01, 0.9  # chance that the test cries wolf, and that it finds what is there
FAR_BEYOND_DOUBT = 1e4  # a noncentrality at which the test always finds the effect
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Rival:
    """One effect among its rivals, on one set of poses.

    Attributes:
        errors: (parameter's name, expected standard error) in the file's units; empty if it cannot be told at all.
        power: probability that the test finds it at its typical size, whatever the mix of its parameters.
        least: size, in typical sizes, from which on it is found in 90 % of cases; None if it cannot be told.
    """

    name: str
    errors: tuple[tuple[str, float], ...]
    power: float
    least: float | None


@dataclass(frozen=True)
class Separation:
    """All rivals on one set of poses. `cosine`: the smallest angle between the first two, 1 where they look alike."""

    rivals: tuple[Rival, ...]
    cosine: float


def check_visible(rest: Equilibrium, effects: Sequence[Effect]) -> None:
    """Raises `LrmError` if an effect cannot show at the poses of an equilibrium."""
    evidence = Evidence(rest.poses, rest.joint_torque)
    for effect in effects:
        why = effect.why_not(evidence)
        if why is not None:
            raise LrmError(f"{effect.id}@{effect.place} cannot show at any of the candidate poses: {why}")


def rival_columns(model: Model, poses: Poses, effects: Sequence[Effect], fitted: Sequence[str]) -> list[Array]:
    """(N, 3, m_k) of each effect: motion of the TCP for parameters of their typical size, pose by pose (mm).

    Shape parameters have their usual values. Raises `LrmError` for an effect that is fitted already.
    """
    wanted = []
    for effect in effects:
        prefix = f"{effect.id}.{effect.place}."
        free = [row for row, p in enumerate(effect.parameters) if p.fixed is None and prefix + p.name not in fitted]
        if not free:
            what = f"{effect.id}@{effect.place}"
            raise LrmError(f"{what} has nothing that is not fitted already; name effects that the model lacks")
        wanted.append((effect, tuple(free)))
    found = candidates(model, poses, wanted)[1]
    return [(c.columns[_usual_shape(c)] * MM_PER_M).reshape(len(poses), 3, -1) for c in found]


def _usual_shape(candidate: Candidate) -> int:
    """Which of the candidate's columns are those at the usual values of its shape parameters."""
    usual = np.array([parameter.default for parameter in candidate.effect.parameters])
    away = [np.abs(np.array(shape) - usual).sum() for shape in candidate.shapes]
    return int(np.argmin(away))


def separation(effects: Sequence[Effect], fitted: Array, rivals: Sequence[Array], noise: float) -> Separation:
    """How well a set of poses tells rivals apart.

    Args:
        effects: the rivals. fitted: (3 n, m), columns of the fitted parameters. rivals: (3 n, m_k), of each rival's
            parameters that are not fitted. All for typical sizes, in mm.
        noise: mm per axis.
    """
    told = []
    for k, columns in enumerate(rivals):
        others = np.concatenate([fitted, *(other for i, other in enumerate(rivals) if i != k)], axis=1)
        told.append(_told(effects[k], others, columns, noise))
    alone = [_beyond(fitted, columns) for columns in rivals]
    cosine = coincidence(alone[0], alone[1]) if len(alone) > 1 else 0.0
    return Separation(tuple(told), min(cosine, 1.0))


def _told(effect: Effect, others: Array, columns: Array, noise: float) -> Rival:
    name, own = f"{effect.id}@{effect.place}", _beyond(others, columns)
    rows, size = own.shape
    freedom = rows - others.shape[1] - size
    values = np.linalg.svd(own, compute_uv=False) / noise
    if freedom < 1 or values[-1] <= ROUND_OFF * float(np.linalg.norm(columns)) / noise:
        return Rival(name, (), LEVEL, None)
    error = np.sqrt(np.diag(np.linalg.inv(own.T @ own))) * noise
    free = [p for p in effect.parameters if p.fixed is None][:size]
    errors = tuple((p.name, float(e * p.typical / p.si)) for p, e in zip(free, error, strict=True))
    noncentrality = float(values[-1] ** 2)
    return Rival(
        name, errors, _power(noncentrality, size, freedom), float(np.sqrt(_needed(size, freedom) / noncentrality))
    )


def _power(noncentrality: float, size: int, freedom: int) -> float:
    """Chance that the F test finds an effect of this noncentrality."""
    if noncentrality > FAR_BEYOND_DOUBT:
        return 1.0
    return float(ncf.sf(f_distribution.isf(LEVEL, size, freedom), size, freedom, noncentrality))


def _needed(size: int, freedom: int) -> float:
    """The noncentrality with which the test finds an effect as surely as `SURE`."""
    return float(brentq(lambda x: _power(x, size, freedom) - SURE, 0.0, FAR_BEYOND_DOUBT))


def _beyond(known: Array, columns: Array) -> Array:
    """What of the columns no combination of the known ones reproduces."""
    share, *_ = np.linalg.lstsq(known, columns, rcond=1e-12)
    return np.asarray(columns - known @ share)
