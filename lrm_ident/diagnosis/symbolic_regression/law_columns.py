"""Design matrix of the laws: motions of the TCP for each law of the grammar, without those that are equal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.weights.whitening import RowWeights
from lrm_ident.diagnosis.symbolic_regression.grammar import Law, extensions_at, laws_at, quantities_at
from lrm_ident.diagnosis.symbolic_regression.search import LawColumns
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from lrm_math.model.derivatives import respond
from lrm_math.model.equilibrium import Equilibrium

TYPICAL_ANGLE, TYPICAL_LENGTH, SEED = 0.02, 0.002, 0  # rad, m
ZERO_LENGTH = 1e-9  # m
OWN = ("tau", "side")  # quantities that differ from joint to joint
FLAT = 0.02  # ratio of a term's deviation from its mean to its largest value, below which it is a constant
Evaluated = dict[tuple[str, ...], tuple[Array, bytes]]


def law_columns(fitted: Fit, data: Measurements) -> list[LawColumns]:
    """The laws of every joint and length, and their motions of the TCP for coefficients of a typical size."""
    groups, weigh, shared = [], RowWeights(data.whitening, fitted.weight), Evaluated()
    equilibrium = fitted.equilibrium
    levers, torque = respond(equilibrium, data.whitening.sensed).slots, equilibrium.joint_torque
    for grammar in _grammars(equilibrium, data.poses):
        laws, values = _distinct(grammar, data.poses, torque, shared)
        if not laws:
            continue
        motion = levers[equilibrium.model.chain.index[laws[0].key]]
        terms = np.concatenate(values, axis=1)
        terms *= typical_size(laws[0]) / np.abs(terms).max(axis=0)
        counts = np.array([len(law.terms) for law in laws])
        first = np.cumsum(counts) - counts
        second = np.where(counts > 1, first + 1, terms.shape[1])
        motions = weigh((motion.T[:, :, None] * terms[:, None, :]).reshape(-1, terms.shape[1]))
        groups.append(
            LawColumns(tuple(laws), np.concatenate([motions, np.zeros((len(motions), 1))], axis=1), first, second)
        )
    return groups


def typical_size(law: Law) -> float:
    """Typical size of a law's motion: rad, or m of a length."""
    return TYPICAL_ANGLE if law.rotates else TYPICAL_LENGTH


def _grammars(equilibrium: Equilibrium, poses: Poses) -> Iterator[Iterable[Law]]:
    """Laws of each joint's rotation, and of each link length that the arm's description gives."""
    model, torque = equilibrium.model, equilibrium.joint_torque
    for joint, link in enumerate(model.arm.joints):
        quantities = quantities_at(joint, poses, torque)
        yield laws_at(joint, quantities)
        lengths = {"a": link.a, "d": link.d}
        for slot in (name for name, length in lengths.items() if abs(length) > ZERO_LENGTH):
            yield extensions_at(joint, slot, quantities)


def _distinct(laws: Iterable[Law], poses: Poses, torque: Array, shared: Evaluated) -> tuple[list[Law], list[Array]]:
    """Laws that differ at these poses by more than a factor and a constant, the simplest first, and their terms (N, m).

    Args:
        shared: cache of the terms, and fingerprints, of laws that are the same at every joint; filled here.
    """
    distinct: dict[bytes, tuple[Law, Array]] = {}
    for law in sorted(laws, key=lambda law_: law_.size):
        quantities = {} if any(quantity.name in OWN for quantity in law.quantities) else shared
        if law.terms not in quantities:
            terms = law.values(poses, torque)
            quantities[law.terms] = terms, _fingerprint(terms)
        terms, fingerprint = quantities[law.terms]
        if fingerprint:
            distinct.setdefault(fingerprint, (law, terms))
    return [law for law, _ in distinct.values()], [terms for _, terms in distinct.values()]


def _fingerprint(terms: Array) -> bytes:
    """Hash of the space of functions (N, m) at these poses: projection of a random vector; empty for a constant."""
    centred = terms - terms.mean(axis=0)
    if (np.abs(centred).max(axis=0) <= FLAT * np.abs(terms).max(axis=0)).any():
        return b""
    probe = np.random.default_rng(SEED).normal(size=len(terms))
    theta = np.linalg.pinv(centred.T @ centred) @ (centred.T @ probe)
    return bytes(np.round(centred @ theta, 5).tobytes())
