"""Hints in the estimates: patterns that several parameters show together, as questions, never as a cause."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.residual.thresholds import FEW_LEVELS, LIKENESS, SURELY
from lrm_math.arrays import Array
from lrm_math.effects import ParameterRef
from lrm_math.effects.base import Excitation
from lrm_math.effects.reference import BASE_OFFSETS
from lrm_math.model.derivatives import parameter_jacobian

OF_THE_ANGLE = ("servo_gain", "eccentricity", "angle_curve", "cable_spring")


class HintKind(StrEnum):
    """Patterns in the estimates, with what `ParameterHint.numbers` are of each."""

    SCALED_LENGTHS = "scaled_lengths"
    """Share by which all lengths differ from the drawing, and its standard error."""
    TURNED_FRAME = "turned_frame"
    """Angle (rad)."""
    FEW_LEVELS = "few_levels"
    """Levels of the joint. Names: its place, then the effects that rest on them."""


@dataclass(frozen=True)
class ParameterHint:
    """A pattern in the estimates. See `HintKind`."""

    kind: HintKind
    numbers: tuple[float, ...]
    names: tuple[str, ...] = ()


def parameter_hints(fitted: Fit) -> tuple[ParameterHint, ...]:
    """One hint for each pattern in the estimates: a scale of all lengths, a turned frame, joints at few levels."""
    count = fitted.equilibrium.true_tcp.size
    columns = parameter_jacobian(fitted.equilibrium, fitted.model.free).reshape(count, len(fitted.model.free))
    return (*_scale(fitted, columns), *_turned_frame(fitted, columns), *_few_levels(fitted))


def _scale(fitted: Fit, columns: Array) -> Iterator[ParameterHint]:
    """Whether the fitted lengths together stretch the arm as a scale error of the tracker would."""
    free = map(ParameterRef.parse, fitted.model.free)
    lengths = [
        parameter.id == "offsets" and parameter.place != "base" and parameter.name.endswith("_mm") for parameter in free
    ]
    others = columns[:, np.logical_not(lengths)]
    motion = _motion(fitted, columns, lengths)
    moved, stretch = _projected_out(others, motion, fitted.equilibrium.true_tcp.reshape(-1, 1))
    share, likeness, error = _amount_of(moved, stretch[:, 0], fitted.sigma)
    if sum(lengths) > 2 and _are_one_motion(share, likeness, error):
        yield ParameterHint(HintKind.SCALED_LENGTHS, (share, error))


def _turned_frame(fitted: Fit, columns: Array) -> Iterator[ParameterHint]:
    """Whether the base's offsets together are a rotation about the origin of the tracker's frame."""
    base = [ParameterRef.parse(key).effect == BASE_OFFSETS for key in fitted.model.free]
    units = {key.rsplit("_", 1)[1] for key, chosen in zip(fitted.model.free, base, strict=True) if chosen}
    if not {"rad", "mm"} <= units:
        return
    moved, tcp = _motion(fitted, columns, base), fitted.equilibrium.true_tcp
    turns = np.stack([np.cross(axis, tcp).reshape(-1) for axis in np.eye(3)], axis=1)
    angles = np.linalg.lstsq(turns, moved, rcond=None)[0]
    angle = float(np.linalg.norm(angles))
    if _are_one_motion(*_amount_of(moved, turns @ angles / max(angle, 1e-300), fitted.sigma)):
        yield ParameterHint(HintKind.TURNED_FRAME, (angle,))


def _few_levels(fitted: Fit) -> Iterator[ParameterHint]:
    """Joints with a fitted effect of their own angle that few angles determine."""
    excitation = Excitation(fitted.equilibrium.poses, fitted.equilibrium.joint_torque)
    free = {ParameterRef.parse(key).effect for key in fitted.model.free}
    for joint, name in enumerate(fitted.model.arm.joint_names):
        levels = excitation.levels(joint)
        kinds = [kind for kind in OF_THE_ANGLE if (kind, name) in free]
        if kinds and levels <= FEW_LEVELS:
            yield ParameterHint(HintKind.FEW_LEVELS, (levels,), (name, *kinds))


def _are_one_motion(amount: float, likeness: float, error: float) -> bool:
    """Whether estimates together are a motion like this one, surely not of zero amount (`_amount_of`)."""
    return likeness > LIKENESS and abs(amount) > SURELY * error


def _motion(fitted: Fit, columns: Array, chosen: Sequence[bool]) -> Array:
    """(3 N,), motion of the TCP (m) by the fitted values of the chosen parameters, from their columns (3 N, P)."""
    values = np.array([fitted.model.value(key) for key in fitted.model.free])
    return np.asarray(columns[:, chosen] @ values[list(chosen)])


def _projected_out(A: Array, moved: Array, columns: Array) -> tuple[Array, Array]:
    """A motion (3 N,) and columns (3 N, m), other parameters' columns A (3 N, k) projected out of both."""
    scaled = A / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    basis = np.linalg.svd(scaled, full_matrices=False)[0]
    return moved - basis @ (basis.T @ moved), columns - basis @ (basis.T @ columns)


def _amount_of(moved: Array, column: Array, sigma: float) -> tuple[float, float, float]:
    """Least-squares amount of a column (3 N,) in a motion (3 N,), their cosine, and the amount's standard error."""
    length, size = float(np.linalg.norm(column)), float(np.linalg.norm(moved))
    if length == 0.0 or size == 0.0:
        return 0.0, 0.0, np.inf
    product = float(moved @ column)
    return product / length**2, abs(product) / (length * size), sigma / length
