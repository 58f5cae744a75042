"""Proposal of a law (symbolic regression): the best of the grammar, refitted in full, and its equivalence class."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.notebook import ShownInNotebook
from lrm_ident.data.weights.whitening import RowWeights
from lrm_ident.data.wording import in_mm
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.diagnosis.screening.screen import linearised
from lrm_ident.diagnosis.symbolic_regression.grammar import Law
from lrm_ident.diagnosis.symbolic_regression.law_columns import law_columns, typical_size
from lrm_ident.diagnosis.symbolic_regression.law_file import how_found, law_id, law_source
from lrm_ident.diagnosis.symbolic_regression.search import LawSearch, search_laws
from lrm_ident.fitting.cross_validation import cross_validated_residual
from lrm_ident.fitting.effect_plugins import effects_in
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.fitting.loss import SQUARED, Loss
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.fitting.typical_prior import typical_prior
from lrm_ident.residual.better_prediction import paired_z, predicts_better
from lrm_ident.residual.thresholds import EQUIVALENT_GAIN, MIN_GAIN, SIGNIFICANCE, Z_THRESHOLD
from lrm_math.arrays import Array
from lrm_math.effects.reference import EffectRef, ParameterRef
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.model.derivatives import respond
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model

REFITS, CLASS_SHOWN = 4, 12  # laws refitted in full; members of the class kept
MOST_LAWS = 3  # that are added up at one joint
NEXT_POSES, DRAWN, SEED = 5, 2000, 0


@dataclass(frozen=True, eq=False)
class RefittedLaw:
    """A law in the nonlinear model: the text of its effect file, the fit with it, and its held-out residual (N, 3)."""

    law: Law
    source: str
    fit: Fit
    held_out: Array

    @property
    def error(self) -> ErrorStats:
        """Held-out error."""
        return error_stats(self.held_out)


class NoLaw(StrEnum):
    """Why no law is proposed."""

    LIKE_NOISE = "like_noise"
    """The best is no better than on pure noise."""
    NOT_PREDICTED = "not_predicted"
    """None predicts poses that were not used to choose it."""
    NOT_REFITTED = "not_better_refitted"
    """None lowers the held-out error once everything is refitted."""


@dataclass(frozen=True, eq=False)
class LawProposal(ShownInNotebook):
    """Result of a search for laws.

    Attributes:
        before: held-out error without a law. nested: RMS of the nested cross-validation (m, linear).
        p_value: of the best law against pure noise. tried: number of laws.
        best: the law that predicts best when everything is refitted; None, for the `reason`, if none is proposed.
        equivalent: laws that the data cannot tell from it, and their held-out RMS (m, linear), the best first.
        next_poses: (k, n), joint angles (rad) at which the best and its rivals differ most.
    """

    before: ErrorStats
    nested: float
    p_value: float
    tried: int
    best: RefittedLaw | None
    reason: NoLaw | None = None
    equivalent: tuple[tuple[Law, float], ...] = ()
    next_poses: Array | None = None

    def __repr__(self) -> str:
        if self.best is None:
            return f"<No law is proposed of {self.tried}: {self.reason}>"
        fall = f"from {in_mm(self.before.rms)} to {in_mm(self.best.error.rms)} mm"
        return f"<Proposed law {self.best.law.formula}: the held-out error falls {fall}; {self.tried} laws tried>"


def propose_law(
    model: Model,
    data: Measurements,
    progress: OnProgress = silent,
    on_progress: Callable[[str], object] = str,
    loss: Loss = SQUARED,
) -> LawProposal:
    """Searches laws at every joint and length; proposes one that beats noise and predicts held-out blocks better.

    Further laws of the same slot are added to it in the same way, `MOST_LAWS` at most.

    Raises `LrmError`: too few poses, or the fit does not converge.
    """
    fitted = fit(model, data, loss=loss, prior=typical_prior(model))
    on_progress("cross-validating the model as it is")
    before = error_stats(cross_validated_residual(fitted.model, data, loss=loss))
    proposal = _propose(fitted, data, before, None, progress, on_progress)
    for _ in range(1, MOST_LAWS):
        best = proposal.best
        more = None if best is None else _propose(fitted, data, best.error, best, progress, on_progress).best
        if more is None:
            break
        proposal = replace(proposal, best=more)
    if proposal.best is not None and proposal.equivalent:
        proposal = replace(proposal, next_poses=_separating_poses(proposal.best, proposal.equivalent, fitted, data))
    return proposal


def _propose(
    fitted: Fit,
    data: Measurements,
    before: ErrorStats,
    refitted: RefittedLaw | None,
    progress: OnProgress,
    on_progress: Callable[[str], object],
) -> LawProposal:
    """The best law at any joint, or the best to add to a `refitted` one, with its equivalence class."""
    start = fitted if refitted is None else refitted.fit
    linear = linearised(start, data, RowWeights(data.whitening, start.weight))
    groups = law_columns(start, data)
    search = search_laws(
        linear, [group for group in groups if refitted is None or group.key == refitted.law.key], progress
    )
    without = linear.baseline.held_out
    nested = float(np.sqrt(search.nested.mean()))
    proposal = LawProposal(before, nested, search.p_value, len(search.laws), None)
    if search.p_value > SIGNIFICANCE:
        return replace(proposal, reason=NoLaw.LIKE_NOISE)
    if not predicts_better(search.nested, without, MIN_GAIN):
        return replace(proposal, reason=NoLaw.NOT_PREDICTED)
    order = np.argsort(search.squares.mean(axis=0))
    classed = _equivalent(search, order, without)
    refits: list[RefittedLaw] = []
    for law, _ in classed[:REFITS]:
        whole = law if refitted is None else refitted.law.plus(law)
        on_progress(f"refitting with {whole.formula}")
        refit = _refit(whole, fitted, data, proposal, refitted)
        refits += [] if refit is None else [refit]
    best = min(refits, key=lambda candidate: candidate.error.rms, default=None)
    if best is None or best.error.rms > (1.0 - MIN_GAIN) * before.rms:
        return replace(proposal, reason=NoLaw.NOT_REFITTED)
    rivals = tuple(rival for rival in classed if rival[0] is not best.law)
    return replace(proposal, best=best, equivalent=rivals[:CLASS_SHOWN])


def _equivalent(search: LawSearch, order: NDArray[np.int64], without: Array) -> list[tuple[Law, float]]:
    """The best law and its equivalence class, the best first: those that save `EQUIVALENT_GAIN` of what it saves, and
    predict not significantly worse."""
    best = search.squares[:, order[0]]
    gain = float(without.mean() - best.mean())
    rivals = []
    for i in order.tolist():
        squares = search.squares[:, i]
        if without.mean() - squares.mean() < EQUIVALENT_GAIN * gain:
            break
        if i == order[0] or paired_z(best, squares) < Z_THRESHOLD:
            rivals.append((search.laws[i], float(np.sqrt(squares.mean()))))
    return rivals


def _refit(
    law: Law, fitted: Fit, data: Measurements, proposal: LawProposal, refitted: RefittedLaw | None
) -> RefittedLaw | None:
    """The law as an effect of its file, everything refitted; None if that fails. `refitted`: the law it extends."""
    largest = np.abs(law.values(data.poses, fitted.equilibrium.joint_torque)).max(axis=0)
    beside = None if refitted is None else refitted.law
    facts = how_found(proposal.tried, beside, proposal.before.rms, proposal.nested, proposal.p_value)
    source = law_source(law, tuple((typical_size(law) / largest).tolist()), data.source.path.name, facts)
    with TemporaryDirectory(prefix="law-") as folder:
        file = Path(folder) / "law.py"
        file.write_text(source, encoding="utf-8")
        (kind,) = effects_in(file)
    try:
        effect = kind(fitted.model.arm, f"joint{law.joint + 1}")
        better = add_effects(fitted.model, data, [effect], loss=fitted.loss)
        return RefittedLaw(law, source, better, cross_validated_residual(better.model, data, loss=fitted.loss))
    except LrmError:
        return None


def _separating_poses(best: RefittedLaw, rivals: Sequence[tuple[Law, float]], fitted: Fit, data: Measurements) -> Array:
    """(k, n), random poses in the measured ranges at which the rivals' motions of the TCP are farthest from the best's.

    Every rival is taken with the coefficients that follow the best law most closely at the measured poses.
    """
    rng = np.random.default_rng(SEED)
    low, high = data.poses.q.min(axis=0), data.poses.q.max(axis=0)
    drawn = replace(data.poses.take(rng.integers(len(data), size=DRAWN)), q=rng.uniform(low, high, (DRAWN, len(low))))
    try:
        there = solve_equilibrium(fitted.model, drawn)
    except NoEquilibrium:
        return np.zeros((0, len(low)))
    model, taken = best.fit.model, EffectRef(law_id(best.law), f"joint{best.law.joint + 1}")
    theta = np.array([model.value(key) for key in model.keys if ParameterRef.parse(key).effect == taken])
    target, elsewhere = _moved(best.law, fitted.equilibrium) @ theta, _moved(best.law, there) @ theta
    apart = np.zeros(DRAWN)
    for law, _ in rivals:
        like, *_ = np.linalg.lstsq(_moved(law, fitted.equilibrium), target, rcond=None)
        apart += ((elsewhere - _moved(law, there) @ like).reshape(-1, 3) ** 2).sum(axis=1)
    return np.asarray(drawn.q[np.argsort(-apart)[:NEXT_POSES]])


def _moved(law: Law, equilibrium: Equilibrium) -> Array:
    """(3 N, terms), motion of the TCP for coefficients of 1 rad or 1 m."""
    terms = law.values(equilibrium.poses, equilibrium.joint_torque)
    lever = respond(equilibrium).slots[equilibrium.model.chain.index[law.key]]
    return np.asarray((lever.T[:, :, None] * terms[:, None, :]).reshape(-1, terms.shape[1]))
