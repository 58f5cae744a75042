"""Cross-validation in joint-space blocks: each pose is predicted by a fit without it and its neighbours.

With many poses a fit that leaves a block out is one Gauss–Newton step from the fit to all (as Cook 1977 for one row).
The step is exact for a linear model, a block moves the parameters by a fraction of their standard errors, and what it
neglects is far below the noise; the Jacobian is computed once instead of per fold.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.row_choice import spaced_rows
from lrm_ident.fitting.field.fit import blocks_with_field
from lrm_ident.fitting.held_out import HeldOutBlock, held_out_residual
from lrm_ident.fitting.least_squares.block_qr import NormalEquations
from lrm_ident.fitting.least_squares.objective import Objective
from lrm_ident.fitting.levenberg_marquardt import Fit, fit, least_poses
from lrm_ident.fitting.loss import SQUARED, Loss
from lrm_ident.fitting.parameter_sets import Bounds, bounds_of
from lrm_ident.fitting.priors import Prior
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.fitting.typical_prior import typical_prior
from lrm_math.arrays import Array
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.kinematics.poses import Poses
from lrm_math.model.deployed_model import as_deployed_when_read, field_of, named_part
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.fixed_point import NewtonPreconditioner
from lrm_math.model.model import Model
from lrm_math.model.state_after_session import state_after_session

OfPoses = TypeVar("OfPoses", Measurements, Equilibrium)
FOLDS = 10
MOST_TRAINING = 1000  # training rows of each fold whose residual is kept, for models of the residual
MOST_REFITTED = 200  # poses up to which every fold is fitted anew; of more, one step differs by less than 0.1 %


@dataclass(frozen=True, eq=False)
class Split:
    """One split of the rows: `test`, which a fit leaves out, and `predicted`: those and some training rows."""

    test: NDArray[np.int64]
    predicted: NDArray[np.int64]

    @staticmethod
    def of(test: NDArray[np.int64], count: int, most: int) -> Split:
        """The split of `count` rows; of the training rows at most `most` are predicted, evenly spread."""
        others = np.setdiff1d(np.arange(count), test)
        return Split(test, np.sort(np.concatenate([test, others[spaced_rows(len(others), most)]])))


def joint_space_folds(q: Array, repeat_of: NDArray[np.int64], count: int = FOLDS) -> NDArray[np.int64]:
    """(N,), fold of each pose: leaves of a k-d tree in joint space (Bentley 1975), so that neighbours stay together.

    Every cut is along the joint of largest spread; the folds differ in size by at most one distinct pose. Poses of
    equal angles and repetitions of a pose share a fold.

    Args:
        q: (N, n), rad.
        repeat_of: (N,), poses of equal number share a fold.

    Raises `LrmError`: fewer distinct poses than folds.
    """
    same = _groups(q, repeat_of, count)
    first = np.unique(same, return_index=True)[1]
    fold = np.empty(len(first), dtype=np.int64)
    for number, rows in enumerate(_bisect(q[first], np.arange(len(first)), count)):
        fold[rows] = number
    return fold[same]


def held_out_folds(data: Measurements) -> NDArray[np.int64]:
    """(N,), fold of each pose: `joint_space_folds`; of touches those of each placement by itself.

    A placement is one part of the joint space: left out as a whole, nothing would say where its board stood.
    """
    if not data.touched or data.poses.placement is None:
        return joint_space_folds(data.poses.q, data.repeat_of)
    fold, begun = np.zeros(len(data), dtype=np.int64), 0
    for number in np.unique(data.poses.placement):
        rows = np.flatnonzero(data.poses.placement == number)
        q, repeat_of = data.poses.q[rows], data.repeat_of[rows]
        folds = joint_space_folds(q, repeat_of, min(FOLDS, int(_groups(q, repeat_of, 1).max()) + 1))
        fold[rows] = (folds + begun) % FOLDS
        begun += int(folds.max()) + 1
    return np.unique(fold, return_inverse=True)[1].reshape(-1)


def random_folds(q: Array, repeat_of: NDArray[np.int64], count: int = FOLDS) -> NDArray[np.int64]:
    """(N,), fold of each pose, drawn at random; poses of equal angles and repetitions of a pose share a fold.

    Such a fold is to the others as new poses of the same kind are to all; one of `joint_space_folds` lies beside them.

    Raises `LrmError`: fewer distinct poses than folds.
    """
    same = _groups(q, repeat_of, count)
    return np.asarray(np.random.default_rng(0).permutation(int(same.max()) + 1) % count)[same]


def _groups(q: Array, repeat_of: NDArray[np.int64], least: int) -> NDArray[np.int64]:
    """(N,), connected components of "equal angles or a repetition", by label propagation.

    Raises `LrmError`: fewer than `least`.
    """
    _, by_angle = np.unique(np.round(q, 6), axis=0, return_inverse=True)
    _, by_number = np.unique(repeat_of, return_inverse=True)
    label, before = np.arange(len(q)), np.full(len(q), -1)
    while not np.array_equal(label, before):
        before = label
        for group in (by_angle.reshape(-1), by_number.reshape(-1)):
            lowest = np.full(len(q), len(q))
            np.minimum.at(lowest, group, label)
            label = lowest[group]
    distinct, same = np.unique(label, return_inverse=True)
    if len(distinct) < least:
        raise LrmError(f"{len(distinct)} distinct poses for {least} folds; measure at least {least}")
    return same.reshape(-1)


def _bisect(q: Array, rows: NDArray[np.int64], count: int) -> Iterator[NDArray[np.int64]]:
    """Leaves of a k-d tree over some rows of q (N, n), `count` of them."""
    if count == 1:
        yield rows
        return
    joint = int(np.argmax(q[rows].std(axis=0)))
    order = rows[np.lexsort((*q[rows].T, q[rows, joint]))]
    left = count // 2
    cut = round(len(rows) * left / count)
    yield from _bisect(q, order[:cut], left)
    yield from _bisect(q, order[cut:], count - left)


def held_out_blocks(
    model: Model,
    data: Measurements,
    bounds: Bounds | None = None,
    loss: Loss = SQUARED,
    progress: OnProgress = silent,
    prior: Prior | None = None,
    fold: NDArray[np.int64] | None = None,
) -> tuple[HeldOutBlock, ...]:
    """Each fold predicted by a fit of the free parameters to the other folds; residuals are measured − predicted TCP.

    Of more than `MOST_REFITTED` poses the folds' fits are one step from the fit to all (`one_step_fits`). A residual
    field is learned anew in every fold, after the fit of what names a cause.

    Args:
        bounds, prior: of the free parameters. fold: (N,), of each pose, from 0; None: `held_out_folds`.

    Raises `LrmError`: too few poses, or a fold that does not converge.
    """
    data, field = data.borne_by(model), field_of(model) if model.free else None
    named = model if field is None else named_part(model)
    splits = _splits(data, fold, MOST_TRAINING if field is None else len(data))
    folds: Iterator[Equilibrium]
    if not named.free:
        everywhere = solve_equilibrium(named, data.poses)
        folds = (_at_rows(everywhere, split.predicted) for split in splits)
    elif len(data) <= MOST_REFITTED:
        _check_enough(len(data), len(named.free), splits, prior)
        folds = _refitted(named, data, splits, bounds, loss, prior)
    else:
        folds = one_step_fits(fit(named, data, bounds, loss, prior), data, splits, bounds, prior)
    blocks = _blocks(data, splits, folds, progress)
    return blocks if field is None else blocks_with_field(field, data, blocks)


def blocks_of_fit(fitted: Fit, data: Measurements) -> tuple[HeldOutBlock, ...]:
    """`held_out_blocks` of a model that was fitted to these data within the bounds that its effects state."""
    if len(data) <= MOST_REFITTED or not fitted.model.free:
        return held_out_blocks(fitted.model, data, loss=fitted.loss, prior=fitted.stated)
    data = data.borne_by(fitted.model)
    splits = _splits(data)
    return _blocks(data, splits, one_step_fits(fitted, data, splits, prior=fitted.stated))


def _splits(data: Measurements, fold: NDArray[np.int64] | None = None, most: int = MOST_TRAINING) -> list[Split]:
    """The split of each fold; at most `most` training rows are predicted."""
    if fold is None:
        fold = held_out_folds(data)
    return [Split.of(np.flatnonzero(fold == number), len(data), most) for number in range(int(fold.max()) + 1)]


def _check_enough(poses: int, parameters: int, splits: Sequence[Split], prior: Prior | None) -> None:
    """Raises `LrmError`: a fold leaves fewer poses than a fit needs."""
    most, least = max(len(split.test) for split in splits), least_poses(parameters, prior)
    if poses - most < least:
        enough = -(-least * len(splits) // max(len(splits) - 1, 1))
        raise LrmError(
            f"{poses} poses for {parameters} parameters: the held-out error leaves out {most} of them at a time, and "
            f"the fit to the other {poses - most} needs {least}; measure at least {max(enough, poses + 1)} poses, or "
            "fit fewer parameters (fit --parameters)"
        )


def _at_rows(whole: OfPoses, rows: NDArray[np.int64]) -> OfPoses:
    """Poses at ascending rows; the same object where these are all, with what it has cached."""
    return whole if len(rows) == len(whole.poses) else whole.take(rows)


def _blocks(
    data: Measurements, splits: Sequence[Split], folds: Iterable[Equilibrium], progress: OnProgress = silent
) -> tuple[HeldOutBlock, ...]:
    """The blocks, from the equilibrium of each fold's fit at its `predicted` rows."""
    blocks, whitening = [], data.whitening
    for number, (split, equilibrium) in enumerate(zip(splits, folds, strict=True)):
        test, rows, held = split.test, split.predicted, np.isin(split.predicted, split.test)
        part, unseen = data.take(test), equilibrium.take(np.flatnonzero(held))
        weighted = None
        if whitening.root is not None:
            weighted = whitening.unit * whitening.take(test)(part.residual(unseen))
        error = _at_rows(data, rows).position_error(equilibrium)
        turn, deployed = part.turn_error(unseen), _deployed_residuals(part, equilibrium, unseen)
        blocks.append(HeldOutBlock(rows[~held], test, error[~held], error[held], weighted, turn, *deployed))
        progress(number + 1, len(splits))
    return tuple(blocks)


def _deployed_residuals(
    part: Measurements, equilibrium: Equilibrium, unseen: Equilibrium
) -> tuple[Array | None, Array | None]:
    """(n, 3), residual of a fold's fit as it is deployed, with the state that its session effects leave behind (m).

    The second: where neither the time since power-on is known nor what the arm did before. None: for a model without
    such effects; as the first. `equilibrium`: at poses from the first measured to the last. `unseen`: at the part's.
    """
    state = state_after_session(equilibrium)
    if state is None:
        return None, None
    model, poses = equilibrium.model.with_state(state), part.poses
    near = unseen.slots
    deployed = part.position_error(solve_equilibrium(as_deployed_when_read(model, poses), poses, near))
    if not (state.warming or state.memory):
        return deployed, None
    return deployed, part.position_error(solve_equilibrium(as_deployed_when_read(model), poses, near))


def _refitted(
    model: Model, data: Measurements, splits: Iterable[Split], bounds: Bounds | None, loss: Loss, prior: Prior | None
) -> Iterator[Equilibrium]:
    """Equilibria of fits to the training rows of each split, at its `predicted` rows."""
    for split in splits:
        refitted = fit(model, data.take(np.setdiff1d(np.arange(len(data)), split.test)), bounds, loss, prior)
        yield solve_equilibrium(refitted.model, _at_rows(data, split.predicted).poses)


def one_step_fits(
    fitted: Fit,
    data: Measurements,
    splits: Sequence[Split],
    bounds: Bounds | None = None,
    prior: Prior | None = None,
) -> Iterator[Equilibrium]:
    """Equilibria of fits to the training rows of each split, one Gauss–Newton step from the fit to all rows.

    Args:
        bounds, prior: of the refit of a fold where the step has no equilibrium; others have the prior of the fit.

    Raises as `fit`.
    """
    model, loss = fitted.model, fitted.loss
    limits = bounds or bounds_of(model, model.free)
    objective = Objective(model, data, loss, fitted.prior)
    typical = objective.typical
    iterate = objective.at(model.values[objective.columns] / typical, fitted.equilibrium)
    free = np.array([key not in fitted.at_bound for key in model.free])
    noise = objective.noise_scale(iterate)
    parts = objective.linearise_each(iterate, noise, [split.test for split in splits])
    preconditioner = objective.preconditioner(fitted.equilibrium)
    for left_out, split in enumerate(splits):
        others = NormalEquations.summed([part.normal for number, part in enumerate(parts) if number != left_out])
        A = objective.gauss_newton(others, noise)[np.ix_(free, free)]
        descent = objective.negative_gradient(iterate, others, noise)
        z = iterate.z.copy()
        z[free] += np.linalg.lstsq(A, descent[free], rcond=None)[0]
        stepped = model.with_values_of(model.free, np.clip(z * typical, limits.lower, limits.upper))
        near = _at_rows(fitted.equilibrium, split.predicted)
        factor = preconditioner if near is fitted.equilibrium else None
        equilibrium = _equilibrium_or_none(stepped, _at_rows(data, split.predicted).poses, near, factor)
        if equilibrium is None:  # the full step went too far: a fit shortens its steps
            yield from _refitted(model, data, [split], bounds, loss, prior)
        else:
            yield equilibrium


def _equilibrium_or_none(
    model: Model, poses: Poses, near: Equilibrium, preconditioner: NewtonPreconditioner | None
) -> Equilibrium | None:
    """The equilibrium from a known one; None if there is none."""
    try:
        return solve_equilibrium(model, poses, near, preconditioner=preconditioner)
    except NoEquilibrium:
        return None


def cross_validated_residual(model: Model, data: Measurements, loss: Loss = SQUARED) -> Array:
    """(N, 3), residual of every pose in the fold that held it out (m), with the prior of typical sizes; errors as of
    `held_out_blocks`."""
    return held_out_residual(held_out_blocks(model, data, loss=loss, prior=typical_prior(model)))
