"""Candidate effects: every effect of the catalogue at every place, and its columns of the total Jacobian."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.diagnosis.reason import Reason, ReasonKind
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, FREE_FORMS, Effect, Parameter, variants
from lrm_math.effects.base import Excitation
from lrm_math.effects.targets import Kind, kind_of
from lrm_math.model.derivatives import Response, effect_columns, respond
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.sensed import TCP_ONLY, Sensed

REFINEMENT, PLAIN, FORM = 0, 1, 2
NO_TORQUE = 1e-9  # N·m: round-off
Unfitted = tuple[Effect, tuple[int, ...]]
"""An effect, and the numbers of its parameters that are not fitted yet."""
Refusal = tuple[Effect, Reason]
"""An effect that cannot be tested, and why."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect at one place that a model lacks, or lacks in part.

    Attributes:
        rows: the effect's parameters that the model does not fit; of a scored candidate only those that move something
            at these poses, since there is no evidence on the others (a spline's coefficients where no pose is).
        shapes: parameter vectors of the effect, one for each combination of shape values that is tried; the other
            parameters are zero, or the model's.
        priority: the lower is preferred in a tie: `REFINEMENT` of an effect of the model, `PLAIN` effect, or another
            `FORM` of an effect that the model does not have.
        response: of the model with every candidate in it, all of them zero.
        scanned: number of shapes that were looked at, of which `shapes` are the likely ones; 0: these alone.
    """

    effect: Effect
    rows: tuple[int, ...]
    shapes: tuple[tuple[float, ...], ...]
    priority: int
    response: Response
    scanned: int = 0

    @property
    def trials(self) -> int:
        """Number of shapes that were tried, by which its p value is corrected."""
        return max(self.scanned, len(self.shapes))

    @property
    def name(self) -> str:
        """`effect@place`."""
        return self.effect.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters that would be fitted."""
        return tuple(self.effect.parameters[row] for row in self.rows)

    def columns(self, shape: tuple[float, ...]) -> Array:
        """(R N, m), Jacobian at a shape in typical sizes: motion of the TCP, pose by pose (m)."""
        acting, moved = self.acting(shape)
        out = np.zeros((len(moved), len(self.rows)), order="F")
        out[:, [self.rows.index(row) for row in acting.rows]] = moved
        return out

    def acting(self, shape: tuple[float, ...]) -> tuple[Candidate, Array]:
        """The candidate without parameters that move nothing at these poses, and its `columns` (R N, m)."""
        columns = list(effect_columns(self.effect, shape, self.response, self.rows))
        rows, count = len(self.response.slots[0]), len(self.response.equilibrium.poses)
        out = np.empty((len(columns), count, rows))
        for column, (row, moved) in zip(out, columns, strict=True):
            np.multiply(moved.T, self.effect.parameters[row].typical, out=column)
        return replace(self, rows=tuple(row for row, _ in columns)), out.reshape(len(out), rows * count).T


def unfitted_effects(model: Model, catalogue: Iterable[type[Effect]] = CATALOGUE) -> Iterator[Unfitted]:
    """Every effect in every form at every place of the model's arm, with the parameters that the model does not fit.

    `quantisation` is left out, since it is known and never fitted.
    """
    for kind in (*catalogue, *FREE_FORMS):
        for place in kind.places(model.arm):
            effect = kind(model.arm, place)
            rows = unfitted_rows(effect, model.free)
            if rows and "counts" not in kind.depends_on:
                yield effect, rows


def _priority(effect: Effect, present: set[str]) -> int:
    """See `Candidate.priority`."""
    if present & {effect.name, *variants(effect)}:
        return REFINEMENT
    return FORM if effect.is_free_form else PLAIN


def unfitted_rows(effect: Effect, fitted: Sequence[str]) -> tuple[int, ...]:
    """Numbers of the effect's parameters that are neither shapes nor among the `fitted` keys."""
    named = enumerate(zip(effect.parameters, effect.keys, strict=True))
    return tuple(i for i, (p, key) in named if p.fixed is None and key not in fitted)


def split_testable(
    effects: Iterable[Unfitted], equilibrium: Equilibrium, sensed: Sensed = TCP_ONLY
) -> tuple[list[Unfitted], list[Refusal]]:
    """The effects that these poses can test, and the others with the reason."""
    excitation = Excitation(equilibrium.poses, equilibrium.joint_torque, sensed.names)
    loaded = _loaded_slots(equilibrium)
    tried = [
        (effect, rows, _no_torque(effect, equilibrium, loaded) or _poses_lack(effect, excitation))
        for effect, rows in effects
    ]
    testable = [(effect, rows) for effect, rows, reason in tried if reason is None]
    return testable, [(effect, reason) for effect, _, reason in tried if reason is not None]


def _loaded_slots(equilibrium: Equilibrium) -> set[int]:
    """Slots of the chain that gravity loads at some pose."""
    every = range(len(equilibrium.model.chain.slots))
    return set(np.flatnonzero(np.abs(equilibrium.loads_on(every)).max(axis=0) >= NO_TORQUE).tolist())


def _poses_lack(effect: Effect, excitation: Excitation) -> Reason | None:
    """What these poses lack, by the effect itself; None if they can show it."""
    lacking = effect.missing_excitation(excitation)
    return None if lacking is None else Reason(ReasonKind.POSES, said=lacking)


def _no_torque(effect: Effect, equilibrium: Equilibrium, loaded: Set[int]) -> Reason | None:
    """Reason why an effect of loads cannot act at these poses: no masses, nothing of the model that gives way to them,
    or no load on its axes; None if it can."""
    kind = kind_of(effect)
    if (effect.load_slots or kind in (Kind.LOAD, Kind.WEIGHT, Kind.GRAVITY)) and equilibrium.weightless:
        return Reason(ReasonKind.MASSLESS)
    if kind is Kind.GRAVITY and all(bound.idle for bound in equilibrium.model.binding.elastic):
        return Reason(ReasonKind.RIGID)
    index = equilibrium.model.chain.index
    felt = {index[key] for key in effect.load_slots if key in index}
    if felt and not felt & loaded:
        return Reason(ReasonKind.UNLOADED)
    return None


def differentiate_candidates(
    equilibrium: Equilibrium, effects: Sequence[Unfitted], sensed: Sensed = TCP_ONLY
) -> tuple[Response, list[Candidate]]:
    """Candidates of all effects, and the response of the model at its equilibrium with all of them at zero."""
    model = equilibrium.model
    present = {effect.name for effect in model.effects}
    added = [effect for effect, _ in effects if effect.name not in present]
    values = {key: model.value(key) for key in model.keys}
    extended = replace(model_of(model.arm, (*model.effects, *added), values), free=model.free, within=model.within)
    response = respond(solve_equilibrium(extended, equilibrium.poses), sensed)
    candidates = (_candidate(extended, effect, rows, response, _priority(effect, present)) for effect, rows in effects)
    return response, list(candidates)


def _candidate(extended: Model, effect: Effect, rows: tuple[int, ...], response: Response, priority: int) -> Candidate:
    """Candidate with all combinations of the shapes to try; of an effect that is fitted in part with its own shape."""
    shapes = [tuple(extended.value(key) for key in effect.keys)]
    if not any(key in extended.free for key in effect.keys):
        tried = effect.shapes_to_try(response.equilibrium.poses)
        for row, parameter in enumerate(effect.parameters):
            if parameter.name in tried:
                shapes = [
                    (*shape[:row], value, *shape[row + 1 :]) for shape in shapes for value in tried[parameter.name]
                ]
    return Candidate(effect, rows, tuple(shapes), priority, response)
