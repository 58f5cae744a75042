"""Discrimination between rival effects by a set of poses, the fitted parameters and the other rivals fitted too.

For rival k with columns C_k, S_k is its information, everything else projected out. If the effect is there with its
typical size, its F test has the noncentrality θᵀS_kθ/σ², here for the worst mix θ of its parameters; from it follows
the power of the test (Atkinson & Fedorov 1975, designs that discriminate between rival models).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtri, ncfdtr

from lrm_ident.design.observability import MM_PER_M
from lrm_ident.diagnosis.screening.candidates import Candidate, differentiate_candidates, unfitted_rows
from lrm_ident.diagnosis.screening.column_spaces import principal_cosine
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.effects.base import Excitation
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium, with_borne_loads
from lrm_math.model.model import Model
from lrm_math.model.sensed import TCP_ONLY, Sensed

TEST_LEVEL, TARGET_POWER = 0.01, 0.9  # of the F test
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Rival:
    """One effect among its rivals, on one set of poses.

    Attributes:
        standard_errors: (parameter's name, expected standard error) in the file's units; empty if not identifiable.
        power: probability that the test finds it at its typical size, whatever the mix of its parameters.
        detectable_size: in typical sizes, from which on it is found with `TARGET_POWER`; None if not identifiable.
    """

    name: str
    standard_errors: tuple[tuple[str, float], ...]
    power: float
    detectable_size: float | None


@dataclass(frozen=True)
class Discrimination:
    """All rivals on one set of poses. `cosine`: the principal cosine of the first two, 1 where they coincide."""

    rivals: tuple[Rival, ...]
    cosine: float


class UnsuitableRival(LrmError):
    """An effect that no poses can tell from others, by its `name`, and `why` not."""

    def __init__(self, name: str, why: str) -> None:
        super().__init__(f"{name} {why}")
        self.name, self.why = name, why


def check_testable(settled: Equilibrium, effects: Sequence[Effect], sensed: Sensed = TCP_ONLY) -> None:
    """Raises `LrmError` if an effect is not testable at the poses of an equilibrium, by what is measured there."""
    excitation = Excitation(settled.poses, settled.joint_torque, sensed.names)
    for effect in effects:
        reason = effect.missing_excitation(excitation)
        if reason is not None:
            raise UnsuitableRival(effect.name, f"cannot show at any of the candidate poses: {reason}")


def rival_columns(
    model: Model, poses: Poses, effects: Sequence[Effect], fitted: Sequence[str], sensed: Sensed = TCP_ONLY
) -> list[Array]:
    """(N, R, m_k) of each effect: motion of the TCP for parameters of their typical size, pose by pose (mm), and of
    what else is `sensed`.

    Shape parameters have their default values. Raises `LrmError` for an effect that is fitted already.
    """
    if not effects:
        return []
    wanted = [(effect, unfitted_rows(effect, fitted)) for effect in effects]
    for effect, rows in wanted:
        if not rows:
            why = "has nothing that is not fitted already; name effects that the model lacks"
            raise UnsuitableRival(effect.name, why)
    differentiated = differentiate_candidates(solve_equilibrium(model, with_borne_loads(model, poses)), wanted, sensed)[
        1
    ]
    each = sensed.rows(model.arm.dof)
    return [(_default_columns(candidate) * MM_PER_M).reshape(len(poses), each, -1) for candidate in differentiated]


def _default_columns(candidate: Candidate) -> Array:
    """The candidate's columns at the scanned shape nearest to the default."""
    default = np.array([parameter.default for parameter in candidate.effect.parameters])
    return candidate.columns(min(candidate.shapes, key=lambda shape: np.abs(np.array(shape) - default).sum()))


def discrimination_of(
    effects: Sequence[Effect], fitted: Array, rivals: Sequence[Array], noise: float
) -> Discrimination:
    """Power of a set of poses to discriminate between rivals.

    Args:
        effects: the rivals. fitted: (3 n, m), columns of the fitted parameters. rivals: (3 n, m_k), of each rival's
            parameters that are not fitted. All for typical sizes, in mm.
        noise: mm per axis.
    """
    tested = []
    for k, columns in enumerate(rivals):
        others = np.concatenate([fitted, *(other for i, other in enumerate(rivals) if i != k)], axis=1)
        tested.append(_test(effects[k], others, columns, noise))
    first_two = [_project_out(fitted, columns) for columns in rivals[:2]]
    cosine = principal_cosine(*first_two) if len(first_two) > 1 else 0.0
    return Discrimination(tuple(tested), min(cosine, 1.0))


def _test(effect: Effect, others: Array, columns: Array, noise: float) -> Rival:
    live = np.flatnonzero(columns.any(axis=0))  # a drift with temperature moves nothing where none is measured
    name, columns = effect.name, columns[:, live]
    independent = _project_out(others, columns)
    rows, size = independent.shape
    if not size:
        return Rival(name, (), TEST_LEVEL, None)
    freedom = rows - others.shape[1] - size
    values = np.linalg.svd(independent, compute_uv=False) / noise
    if freedom < 1 or values[-1] <= ROUND_OFF * float(np.linalg.norm(columns)) / noise:
        return Rival(name, (), TEST_LEVEL, None)
    error = np.sqrt(np.diag(np.linalg.inv(independent.T @ independent))) * noise
    free = [[p for p in effect.parameters if p.fixed is None][k] for k in live]
    errors = tuple((p.name, float(e * p.typical / p.si)) for p, e in zip(free, error, strict=True))
    noncentrality = float(values[-1] ** 2)
    detectable_size = float(np.sqrt(_required_noncentrality(size, freedom) / noncentrality))
    return Rival(name, errors, _power(noncentrality, size, freedom), detectable_size)


def _power(noncentrality: float, size: int, freedom: int) -> float:
    """Power of the F test at this noncentrality (noncentral F distribution)."""
    missed = float(ncfdtr(size, freedom, noncentrality, float(fdtri(size, freedom, 1.0 - TEST_LEVEL))))
    return 1.0 if math.isnan(missed) else 1.0 - missed  # it underflows at some noncentralities of a power of one


def _required_noncentrality(size: int, freedom: int) -> float:
    """The noncentrality at which the test has `TARGET_POWER`."""
    from scipy.optimize import brentq  # takes a quarter of a second to load

    enough = 1.0
    while _power(enough, size, freedom) < TARGET_POWER:
        enough *= 2.0
    return float(brentq(lambda x: _power(x, size, freedom) - TARGET_POWER, 0.0, enough))


def _project_out(basis: Array, columns: Array) -> Array:
    """The columns less their least-squares fit by the known ones."""
    share, *_ = np.linalg.lstsq(basis, columns, rcond=1e-12)
    return np.asarray(columns - basis @ share)
