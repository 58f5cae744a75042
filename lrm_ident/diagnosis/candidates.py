"""Everything that might be missing: each effect of the catalogue at each place, as columns of the total Jacobian."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, Effect, Parameter
from lrm_math.effects.base import Evidence
from lrm_math.kinematics.poses import Poses
from lrm_math.model.derivatives import Response, effect_columns, respond
from lrm_math.model.equilibrium import Equilibrium, equilibrium
from lrm_math.model.model import Model, model_of

KNOWN = ("quantisation",)  # not fitted, so nothing to find


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect at one place that a model lacks, or lacks in part.

    Attributes:
        rows: which of the effect's parameters are not in the model yet.
        shapes: for each combination of shape values that is tried: the effect's parameter vector at which its other
            parameters are zero (or the model's).
        columns: for each of them (3 N, m): motion of the TCP for parameters of their typical size, pose by pose (m).
    """

    effect: Effect
    rows: tuple[int, ...]
    shapes: tuple[tuple[float, ...], ...]
    columns: tuple[Array, ...]

    @property
    def name(self) -> str:
        """`effect@place`."""
        return f"{self.effect.id}@{self.effect.place}"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters that would be fitted."""
        return tuple(self.effect.parameters[row] for row in self.rows)


def catalogue_of(
    model: Model, catalogue: Iterable[type[Effect]] = CATALOGUE
) -> Iterator[tuple[Effect, tuple[int, ...]]]:
    """Every effect at every place of the model's arm, with the parameters that the model does not fit."""
    free = set(model.free)
    for kind in catalogue:
        for place in kind.places(model.arm):
            effect = kind(model.arm, place)
            rows = tuple(
                row
                for row, parameter in enumerate(effect.parameters)
                if parameter.fixed is None and f"{kind.id}.{place}.{parameter.name}" not in free
            )
            if rows and kind.id not in KNOWN:
                yield effect, rows


def split_testable(
    model: Model, rest: Equilibrium, catalogue: Iterable[type[Effect]] = CATALOGUE
) -> tuple[list[tuple[Effect, tuple[int, ...]]], list[tuple[Effect, str]]]:
    """The catalogue's effects that these poses might show, and the others with the reason."""
    evidence = Evidence(rest.poses, rest.joint_torque)
    testable, refused = [], []
    for effect, rows in catalogue_of(model, catalogue):
        why = effect.why_not(evidence)
        if why is None:
            testable.append((effect, rows))
        else:
            refused.append((effect, why))
    return testable, refused


def candidates(
    model: Model, poses: Poses, effects: Sequence[tuple[Effect, tuple[int, ...]]]
) -> tuple[Response, list[Candidate]]:
    """The columns of every effect at the model's equilibrium, where none of them acts yet."""
    present = {(effect.id, effect.place) for effect in model.effects}
    added = [effect for effect, _ in effects if (effect.id, effect.place) not in present]
    known = {key: model.value(key) for key in model.keys}
    wide = replace(model_of(model.arm, (*model.effects, *added), known), free=model.free)
    response = respond(equilibrium(wide, poses))
    return response, [_candidate(wide, effect, rows, response) for effect, rows in effects]


def _candidate(wide: Model, effect: Effect, rows: tuple[int, ...], response: Response) -> Candidate:
    parameters = effect.parameters
    prefix = f"{effect.id}.{effect.place}."
    present = [wide.value(prefix + parameter.name) for parameter in parameters]
    shapes = _shapes(parameters, present, fixed=any(prefix + p.name in wide.free for p in parameters))
    typical = np.array([parameters[row].typical for row in rows])
    columns = []
    for shape in shapes:
        moved = effect_columns(effect, shape, response)[list(rows)]
        columns.append((moved.transpose(2, 1, 0) * typical).reshape(-1, len(rows)))
    return Candidate(effect, rows, shapes, tuple(columns))


def _shapes(parameters: Sequence[Parameter], present: Sequence[float], fixed: bool) -> tuple[tuple[float, ...], ...]:
    """Parameter vectors with each value of a shape parameter that is worth trying."""
    shapes = [tuple(present)]
    for row, parameter in enumerate(parameters):
        if parameter.scan and not fixed:
            shapes = [(*shape[:row], value, *shape[row + 1 :]) for shape in shapes for value in parameter.scan]
    return tuple(shapes)
