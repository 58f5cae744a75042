"""Free functions: smooth functions at one place that describe a residual whatever its physical cause.

- A rotation of a joint as a Legendre series of one or two covariates: joint angles, the joint's own torque (at the pose
  or at those before: creep), order of measurement; or of the joint's own last motion (a lag).
- A radial motion of a joint's axis as a function of the force across it; of the other error motions of an axis of
  rotation (ISO 230-7) tilt and axial motion are effects of the catalogue.
- Common modes: a gain or a compliance that all joints share, or a scale of all lengths, as a function of the total
  torque, load, order, time or temperature: one cause that else many local effects would imitate.
A named effect must not predict far worse than a free function at its own place, and structure that no effect explains
is described by the best of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from itertools import combinations, product

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.residual.covariates import (
    CONSTANT,
    Covariate,
    ExplanatoryVariable,
    covariates,
    distinct,
    levels,
    scaled,
)
from lrm_math.arrays import Array
from lrm_math.kinematics.forward import frames
from lrm_math.model.equilibrium import Equilibrium

SINGLE_DEGREE, PRODUCT_DEGREE, TYPICAL_SIZE = 6, 5, 0.02  # degrees of the Legendre polynomials; rad
TYPICAL_SHIFT = 1e-3  # m
RADIAL_SCALES = (0.03, 0.15, 0.7)  # s, in parts of the largest force across an axis
MEMORY = 12  # poses before, of whose torques creep is a function
COMMON_DRIVERS = ("load", "order", "time", "temperature")


class CommonMode(StrEnum):
    """What all joints, or all lengths, may share."""

    GAIN = "gain"
    YIELDING = "yielding"
    SCALE = "scale"


@dataclass(frozen=True, eq=False)
class RadialShift:
    """Weight across a joint's axis at each pose: `force` (N,) in N, and unit `direction` (3, N) in world axes."""

    force: Array
    direction: Array


@dataclass(frozen=True, eq=False)
class FreeFunction:
    """A motion of one place as a function of one or two covariates.

    Attributes:
        joint: from 0, that moves; None for a `common` mode.
        terms: motions of the TCP (R, N) for a unit amount, m or m/rad, each with a basis (N, m) of the amount.
        shift: force of a radial motion; None for a rotation.
    """

    joint: int | None
    covariates: tuple[ExplanatoryVariable, ...]
    terms: tuple[tuple[Array, Array], ...]
    shift: RadialShift | None = None
    common: CommonMode | None = None

    @property
    def place(self) -> CommonMode | int | None:
        """The joint, or the common mode."""
        return self.common if self.joint is None else self.joint

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return sum(basis.shape[1] for _, basis in self.terms)

    @property
    def columns(self) -> Array:
        """(R N, size), motion of the TCP for coefficients of a typical size (m)."""
        return np.concatenate([_columns(motion, basis).T for motion, basis in self.terms]).T

    @property
    def in_catalogue(self) -> bool:
        """Whether effects of the catalogue are such functions: of its own angle, torque now or before, or the order."""
        if self.joint is None or len(self.covariates) != 1:
            return False
        covariate = self.covariates[0]
        return covariate.kind == "order" or (covariate.kind in ("angle", "torque") and covariate.joint == self.joint)


def free_functions(
    joint_jacobian: Array, data: Measurements, equilibrium: Equilibrium, torque_before: Array
) -> list[FreeFunction]:
    """Free functions of every covariate at every joint, then products of every pair of covariates.

    Functions of a joint's torque before are linear in the torques at the last `MEMORY` poses (creep). Products have no
    factor of degree zero; their degrees add up to at most `PRODUCT_DEGREE` + 1.

    Args:
        joint_jacobian: (n, 3, N), motion of the TCP for a unit rotation of each joint (m/rad).
        torque_before: (N, `MEMORY`, n), scaled, at the poses measured before (`lagged`).
    """
    covariates_known = [
        covariate
        for covariate in covariates(data, equilibrium.joint_torque)
        if len(levels(scaled(covariate.values), 3)[0]) > 1
    ]
    shared = [covariate for covariate in covariates_known if covariate.kind in ("angle", "order")]
    univariate = _radial(joint_jacobian, equilibrium) + _common_modes(joint_jacobian, data, equilibrium)
    bivariate, products = [], cache(_products)  # alike at every joint
    for joint, motion in enumerate(joint_jacobian):
        torques = [
            covariate for covariate in covariates_known if covariate.kind == "torque" and covariate.joint == joint
        ]
        moved = [covariate for covariate in covariates_known if covariate.kind == "motion" and covariate.joint == joint]
        candidates = [*shared, *torques]
        for torque in torques:
            before = replace(torque.variable, before=True)
            univariate.append(FreeFunction(joint, (before,), ((motion, torque_before[:, :, joint]),)))
        for torque in (*candidates, *moved):
            univariate.append(
                FreeFunction(joint, (torque.variable,), ((motion, torque.legendre_basis(SINGLE_DEGREE)),))
            )
        for a, b in combinations(candidates, 2):
            basis = products(a, b)
            if basis is not None:
                bivariate.append(FreeFunction(joint, (a.variable, b.variable), ((motion, basis),)))
    return univariate + bivariate


def _products(a: Covariate, b: Covariate) -> Array | None:
    """(N, m), products of Legendre polynomials of two covariates; None where a covariate has too few levels."""
    left, right = a.legendre_basis(PRODUCT_DEGREE), b.legendre_basis(PRODUCT_DEGREE)
    degrees = product(range(left.shape[1]), range(right.shape[1]))
    products = [left[:, i] * right[:, j] for i, j in degrees if i + j < PRODUCT_DEGREE]
    return np.stack(products, axis=1) if products else None


def _radial(joint_jacobian: Array, equilibrium: Equilibrium) -> list[FreeFunction]:
    """Radial motions of every joint's axis under the weight F across it: Σ c F / √(|F|² + s²) over `RADIAL_SCALES`."""
    chain, count, functions = equilibrium.model.chain, len(equilibrium.poses), []
    axes = frames(chain, equilibrium.slots, count)[:, :, :3, :2]
    gravity = np.stack([np.broadcast_to(g, count) for g in equilibrium.gravity], axis=1)
    mass = np.array([np.broadcast_to(weight.mass, count) for weight in equilibrium.weights]).reshape(-1, count)
    for joint, name in enumerate(equilibrium.model.arm.joint_names):
        before = equilibrium.model.arm.link_places.index(name)
        carried = mass[chain.counted[chain.index[f"{name}.d"]] :].sum(axis=0)
        force = carried[:, None] * np.einsum("nc,nck->nk", gravity, axes[:, before])
        square = (force**2).sum(axis=1, keepdims=True)
        scales = float(np.sqrt(square.max(initial=0.0))) * np.array(RADIAL_SCALES)
        if not scales.any():
            continue
        taken = force[:, :, None] / np.sqrt(square[:, :, None] + scales**2)
        terms = []
        for axis, basis in zip(axes[:, before].transpose(2, 1, 0), taken.transpose(1, 0, 2), strict=True):
            motion = np.zeros_like(joint_jacobian[joint])
            motion[:3] = axis * (TYPICAL_SHIFT / TYPICAL_SIZE)
            terms.append((motion, basis))
        world = np.einsum("nck,nk->cn", axes[:, before], force)
        size = np.linalg.norm(world, axis=0)
        shift = RadialShift(size, world / np.maximum(size, CONSTANT))
        functions.append(FreeFunction(joint, (ExplanatoryVariable("force"),), tuple(terms), shift))
    return functions


def _common_modes(joint_jacobian: Array, data: Measurements, equilibrium: Equilibrium) -> list[FreeFunction]:
    """Common modes: a gain or compliance of all joints, a scale of all lengths, as functions of shared covariates."""
    torque = equilibrium.joint_torque
    drivers = [covariate for covariate in covariates(data, torque[:, :0]) if covariate.kind in COMMON_DRIVERS]
    if np.ptp(total := np.abs(torque).sum(axis=1)) > CONSTANT:
        drivers.append(Covariate("total torque", total))
    told_apart = distinct({covariate.variable: covariate.values for covariate in drivers})
    stretch = np.zeros_like(joint_jacobian[0])
    stretch[:3] = equilibrium.tcp.T
    motions = {
        CommonMode.GAIN: np.einsum("jrn,nj->rn", joint_jacobian, data.poses.q),
        CommonMode.YIELDING: np.einsum("jrn,nj->rn", joint_jacobian, torque),
        CommonMode.SCALE: stretch,
    }
    constant = np.ones((len(data), 1))
    bases = {
        covariate.variable: np.hstack([constant, covariate.legendre_basis(SINGLE_DEGREE)])
        for covariate in drivers
        if covariate.variable in told_apart
    }
    return [
        FreeFunction(None, (variable,), ((motion, basis),), common=mode)
        for mode, motion in motions.items()
        for variable, basis in bases.items()
        if motion.any()
    ]


def lagged(values: Array) -> Array:
    """(N, `MEMORY`, n), values (N, n), scaled to −1 … 1, at each of the poses before; before the first pose its own."""
    every = scaled(values)
    ahead = np.concatenate([np.repeat(every[:1], MEMORY, axis=0), every])
    return np.stack([ahead[MEMORY - lag : len(ahead) - lag] for lag in range(1, MEMORY + 1)], axis=1)


def _columns(motion: Array, basis: Array) -> Array:
    """(R N, m), motion of the TCP for each coefficient of a basis (N, m) at its typical size (m)."""
    return (basis.T[:, :, None] * (motion.T * TYPICAL_SIZE)).reshape(basis.shape[1], -1).T
