"""Every threshold of the verdicts: a case on either side of it, which a change of it by a quarter would decide anew."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lrm_ident.diagnosis import candidate_trial, forward_selection, unexplained_structure
from lrm_ident.diagnosis.attribution import attribute_steps
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.evidence import Evidence
from lrm_ident.diagnosis.screening import score_test
from lrm_ident.diagnosis.symbolic_regression import proposal
from lrm_ident.residual import data_audit, parameter_hints, regime, thresholds
from lrm_ident.residual.better_prediction import predicts_better, share_of_excess, takes_little
from lrm_ident.residual.predictability import PredictableError
from lrm_ident.residual.residual_structure import ResidualStructure
from lrm_math.arrays import Array

MANY = 400
Patch = pytest.MonkeyPatch


def squares(mean: float = 1.0) -> Array:
    """(N,), equal squared distances."""
    return np.full(MANY, mean)


def fallen(share: float, z: float = 1000.0) -> Array:
    """(N,), squared distances whose RMS is by a share below 1, by so many standard errors."""
    fall = 1.0 - (1.0 - share) ** 2
    spread = fall / z * math.sqrt(MANY - 1)
    return squares(1.0 - fall) + spread * np.where(np.arange(MANY) % 2, 1.0, -1.0)


def estimate(held_out: Array, in_sample: float = 1.0) -> Any:
    return SimpleNamespace(held_out=held_out, in_sample=in_sample, rms=math.sqrt(held_out.mean()))


def significant_structure(p_value: float, _: Patch) -> bool:
    return ResidualStructure(0.5, 0.5 * p_value, 1.0).significant  # it pays for both of its tests


def surely_better(z: float, _: Patch) -> bool:
    return predicts_better(fallen(0.02, z), squares(), 0.01)


def worse_as_deployed(z: float, patch: Patch) -> bool:
    patch.setattr(candidate_trial, "rows_as_deployed", lambda *_: slice(None))
    patch.setattr(candidate_trial, "deployed_residual", lambda blocks: np.sqrt(blocks)[:, None])
    fit = SimpleNamespace(model=None, equilibrium=SimpleNamespace(poses=None))
    refit: Any = SimpleNamespace(fit=fit, blocks=squares())
    cause: Any = SimpleNamespace(is_free_form=False)
    return candidate_trial._worse_as_deployed([cause], refit, fallen(0.01, z)) is not None  # type: ignore[arg-type]


def parameters_near_zero(p_value: float, patch: Patch) -> bool:
    patch.setattr(candidate_trial, "wald_p_value", lambda *_: p_value)
    patch.setattr(candidate_trial, "implausible_of", lambda _: ())
    return candidate_trial.objection_to_estimates(None, (), ()) is not None  # type: ignore[arg-type]


def worth_naming(share: float, _: Patch) -> bool:
    return forward_selection.improves_prediction(estimate(fallen(share)), estimate(squares()), estimate(squares()))


def free_functions(count: int, in_sample: float, share: float, patch: Patch) -> int:
    """How many functions outside the catalogue are taken, of some that each save as much."""
    functions: dict[Any, float] = {SomeFunction(number=number): 1.0 - in_sample for number in range(count)}
    fit: Any = SimpleNamespace(baseline=estimate(squares()), beside=lambda _: fit)
    patch.setattr(unexplained_structure, "_explained", lambda of, *_: {one: estimate(fallen(share)) for one in of})
    patch.setattr(unexplained_structure, "_projected", lambda *_: None)
    patch.setattr(unexplained_structure, "_squares", lambda of, *_: dict.fromkeys(of, 1.0 - in_sample))
    return len(unexplained_structure._select_free(functions, fit, None))  # type: ignore[arg-type]


class SomeFunction:
    """A function outside the catalogue."""

    in_catalogue, place = False, "joint1"

    def __init__(self, number: int) -> None:
        self.number = number


def unexplained(share: float, patch: Patch) -> bool:
    return free_functions(1, 0.9, share, patch) == 1


def promising(part: float, patch: Patch) -> bool:
    """A function that saves a part of what it must save held out, in the sample."""
    return free_functions(1, part * (1.0 - (1.0 - thresholds.MIN_FREE_GAIN) ** 2), 0.5, patch) == 1


def functions_taken(count: float, patch: Patch) -> bool:
    return free_functions(10, 0.9, 0.5, patch) < count


def more_to_find(share: float, _: Patch) -> bool:
    before, after = (np.sqrt(of)[:, None] * [[1.0, 0.0, 0.0]] for of in (squares(), fallen(share)))
    return PredictableError(before, after, (), MANY).more_to_find


def effects_selected(count: float, patch: Patch) -> bool:
    patch.setattr(forward_selection, "_next_effect", lambda *_: SimpleNamespace(projected=None))
    start: Any = SimpleNamespace(screened=[], beside={}, fit=SimpleNamespace(baseline=None))
    start.extended_by = lambda _: start
    return len(forward_selection.forward_select(start, lambda *_: None).effects) < count


def alike_in_motion(cosine: float, _: Patch) -> bool:
    first, other = (np.array([[math.cos(a)], [math.sin(a)]]) for a in (0.0, math.acos(cosine)))
    one, rival = (SimpleNamespace(orthonormal=basis) for basis in (first, other))
    return forward_selection._inseparable(one, estimate(fallen(0.5)), rival, estimate(squares()))  # type: ignore[arg-type]


def of_one_class(gain: float, patch: Patch) -> bool:
    after, instead = squares(0.5), squares(1.0 - 0.5 * gain) + np.where(np.arange(MANY) % 2, 0.9, -0.9)
    search: Any = SimpleNamespace(squares=np.stack([after, instead], axis=1), laws=("best", "other"))
    patch.setattr(proposal, "paired_z", lambda *_: 0.0)
    return len(proposal._equivalent(search, np.array([0, 1]), squares())) == 2


def saves_as_much(gain: float, _: Patch) -> bool:
    best, after = estimate(squares(0.5)), estimate(squares(1.0 - 0.5 * gain))
    return unexplained_structure._saves_as_much(after, best, estimate(squares()))


def takes_enough(share: float, _: Patch) -> bool:
    return not takes_little(math.sqrt(10.0 - 9.0 * share), math.sqrt(10.0), 1.0)


def much_is_left(ratio: float, _: Patch) -> bool:
    return attribute_steps([(1.0, Evidence())], ratio)[0].kind != "finding"


def no_excess(part: float, _: Patch) -> bool:
    before = math.sqrt(1.0 + part)
    return share_of_excess(1.0, before, before) > 1.0


def needs_too_many_parameters(difference: float, _: Patch) -> bool:
    """By Schwarz's criterion beside the most helpful effect."""
    count = 100
    left = {"a": (1.0, 1.0), "b": (2.0, math.exp(difference / count))}
    helpful, other = (
        SimpleNamespace(
            scored=SimpleNamespace(size=1, name=name), estimate=SimpleNamespace(rms=rms, in_sample=in_sample)
        )
        for name, (rms, in_sample) in left.items()
    )
    kept = forward_selection._parsimonious([helpful, other], {"a": 0, "b": 0}, count)  # type: ignore[list-item]
    return len(kept) == 1


class DetectableError(Exception):
    """Raised where a candidate would be scored."""


def detectable(times: float, patch: Patch) -> bool:
    trial = SimpleNamespace(candidate=SimpleNamespace(trials=1, effect=None), rank=1, in_sample=1.0)
    patch.setattr(score_test, "_at_best_shapes", lambda *_: [(trial, np.array([times]))])
    patch.setattr(score_test, "f_test_p_value", lambda *_: 1.0)

    def together(kept: list[Array], _: int) -> tuple[()]:
        if kept:
            raise DetectableError
        return ()

    patch.setattr(score_test, "side_by_side", together)
    linear: Any = SimpleNamespace(
        sigma=1.0, rows=1, measured=1, residual=[0.0], degrees_of_freedom=1, baseline=estimate(squares()),
        in_folds=lambda: [], explain_each=lambda _: [],
    )  # fmt: skip
    try:
        score_test.score_candidates([trial], linear, None, lambda *_: None)  # type: ignore[list-item,arg-type]
    except DetectableError:
        return True
    return False


def stays_above_noise(ratio: float, _: Patch) -> bool:
    return takes_little(ratio, ratio * 1.0001, 1.0)


def diagnosis(**known: Any) -> Any:
    nothing = SimpleNamespace(functions=())
    return SimpleNamespace(**{"supported": (), "unexplained": nothing, "above_floor": False, **known})


def alike_neighbours(moran: float, _: Patch) -> bool:
    found = diagnosis(structure=ResidualStructure(moran, 0.0, 0.0), floor=SimpleNamespace(sd=None))
    return bool(Diagnosis.verdict.fget(found) == "unexplained_structure")  # type: ignore[attr-defined]


def like_noise(p_value: float, _: Patch) -> bool:
    found = diagnosis(
        floor=SimpleNamespace(sd=1.0),
        fit=SimpleNamespace(sigma=2.0),
        screening=SimpleNamespace(lack_of_fit_p_value=p_value),
    )
    return not Diagnosis.above_floor.fget(found)  # type: ignore[attr-defined]


def regime_worth_saying(ratio: float, patch: Patch) -> bool:
    quantity = SimpleNamespace(variable="q1", kind=next(iter(regime.UNITS)))
    patch.setattr(regime, "covariates", lambda *_: [quantity])
    patch.setattr(regime, "_halves", lambda _: [np.arange(MANY) % 2 == 0])
    for name in ("_aggregated_p_value", "_parts", "_ranks", "_best_interval"):
        patch.setattr(regime, name, lambda *_: 0.0)
    patch.setattr(regime, "_regime", lambda *_: SimpleNamespace(inside=ratio, outside=1.0))
    data: Any = SimpleNamespace(repeat_of=None, __len__=None)
    patch.setattr(regime, "len", lambda _: MANY, raising=False)
    return bool(regime.find_regimes(data, squares()))


def taken_for_regime(inside: int) -> bool:
    """Whether an interval of so many of the poses may be a regime."""
    parts, every = np.where(np.arange(MANY) < inside, 1, 0), np.ones(MANY, dtype=np.bool_)
    return bool(regime._interval_scores(parts, every, np.arange(MANY))[1][1, 2])


def part_is_regime(share: float, _: Patch) -> bool:
    return taken_for_regime(round(share * MANY))


def few_are_regime(count: float, _: Patch) -> bool:
    return taken_for_regime(int(count))


def beyond_bound(motion: float, _: Patch) -> bool:
    """Whether an effect of one parameter, estimated as zero, may not move the TCP by so many standard errors."""
    one = SimpleNamespace(
        name="one", added=np.zeros((3, 1)), parameter_count=1, implausible=None,
        candidate=SimpleNamespace(effect=SimpleNamespace(is_free_form=False)),
    )  # fmt: skip
    found = diagnosis(scored=[one], fit=SimpleNamespace(sigma=1.0), screening=SimpleNamespace(screened=[0]))
    return bool(Diagnosis.motion_bounds.func(found)["one"] < motion)  # type: ignore[attr-defined]


def few_angles(count: float, _: Patch) -> bool:
    excitation: Any = SimpleNamespace(torque=np.zeros((MANY, 1)), levels=lambda _: count)
    return bool(list(data_audit._levels(excitation)))


def follows_order(correlation: float, _: Patch) -> bool:
    order = np.arange(MANY) - (MANY - 1) / 2
    across = order**2 - np.mean(order**2)  # even, so that it is not correlated with the order
    q = correlation * order / np.std(order) + math.sqrt(1.0 - correlation**2) * across / np.std(across)
    return bool(data_audit.joints_of_order(q[:, None]))


def holds_in_a_part(share: float, _: Patch) -> bool:
    """Of a joint that was measured over a share of its range."""
    return bool(data_audit.where_it_holds(np.linspace(0.0, share, MANY)[:, None], np.zeros(1), np.ones(1)))


def like_one_motion(cosine: float, _: Patch) -> bool:
    return parameter_hints._are_one_motion(1.0, cosine, 0.1)


def surely_one_motion(amount: float, _: Patch) -> bool:
    return parameter_hints._are_one_motion(-amount, 1.0, 1.0)


Case = tuple[Callable[[float, Patch], bool], float, float]
CASES: dict[str, Case] = {
    "SIGNIFICANCE": (significant_structure, 0.011, 0.009),
    "Z_THRESHOLD": (surely_better, 1.8, 2.2),
    "ONE_DEVIATION": (worse_as_deployed, 0.9, 1.1),
    "MAX_WALD_P": (parameters_near_zero, 0.04, 0.05),
    "MIN_GAIN": (worth_naming, 0.018, 0.022),
    "MIN_FREE_GAIN": (unexplained, 0.09, 0.11),
    "MAX_FREE_FUNCTIONS": (functions_taken, 3, 4),
    "PROMISING": (promising, 0.45, 0.55),
    "MIN_NAMELESS_GAIN": (more_to_find, 0.045, 0.055),
    "MOST_SELECTED": (effects_selected, 8, 9),
    "EQUIVALENCE_COSINE": (alike_in_motion, 0.94, 0.96),
    "EQUIVALENT_GAIN": (of_one_class, 0.45, 0.55),
    "SIMILAR_GAIN": (saves_as_much, 0.75, 0.85),
    "SMALL_SHARE": (takes_enough, 0.14, 0.16),
    "MAX_UNEXPLAINED_RATIO": (much_is_left, 0.31, 0.36),
    "NEGLIGIBLE": (no_excess, 0.9e-3, 1.1e-3),
    "VERY_STRONG": (needs_too_many_parameters, 9.0, 11.0),
    "MIN_DETECTABLE": (detectable, 2.7, 3.3),
    "FLOOR_RATIO": (stays_above_noise, 1.1, 1.2),
    "MORAN_THRESHOLD": (alike_neighbours, 0.09, 0.11),
    "NOT_NOISE": (like_noise, 0.9e-3, 1.1e-3),
    "MIN_REGIME_RATIO": (regime_worth_saying, 1.4, 1.6),
    "LARGEST_REGIME": (part_is_regime, 0.52, 0.48),
    "FEWEST_IN_REGIME": (few_are_regime, 7, 8),
    "MISSED": (beyond_bound, 1.9, 2.0),
    "FEW_LEVELS": (few_angles, 5, 4),
    "STRONG_CORRELATION": (follows_order, 0.79, 0.81),
    "MOST_OF_RANGE": (holds_in_a_part, 0.68, 0.65),
    "LIKENESS": (like_one_motion, 0.97, 0.99),
    "SURELY": (surely_one_motion, 4.9, 5.1),
}
"""By threshold: a decision, a figure for which it is no, and one for which it is yes."""
DEFAULTS_OF_COMMANDS = {"MAX_EFFECTS"}
"""What a command's `--help` states, and a person may choose otherwise; `test_rules_of_refits` holds it."""


def held(case: Case) -> bool:
    """Whether a decision is as written on both sides of its threshold."""
    decision, no, yes = case
    for figure, right in ((no, False), (yes, True)):
        with pytest.MonkeyPatch.context() as patch:
            if decision(figure, patch) is not right:
                return False
    return True


@pytest.mark.parametrize("name", CASES)
def test_a_threshold_stands_where_it_is_stated(name: str) -> None:
    assert held(CASES[name])


def changed(value: float, factor: float) -> float:
    if isinstance(value, int):
        return math.ceil(value * factor) if factor > 1.0 else math.floor(value * factor)
    return value * factor


@pytest.mark.parametrize("factor", [0.75, 1.33])
@pytest.mark.parametrize("name", CASES)
def test_a_threshold_changed_by_a_quarter_is_seen(name: str, factor: float, monkeypatch: pytest.MonkeyPatch) -> None:
    value = getattr(thresholds, name)
    users = [module for path, module in sys.modules.items() if path.startswith("lrm_ident.") and hasattr(module, name)]
    for module in users:
        if getattr(module, name) == value:
            monkeypatch.setattr(module, name, changed(value, factor))
    assert not held(CASES[name])


def test_every_threshold_has_its_cases() -> None:
    assert {name for name in vars(thresholds) if name.isupper()} == {*CASES, *DEFAULTS_OF_COMMANDS}


def test_a_form_of_the_arm_that_leaves_the_deployed_error_is_refused(monkeypatch: Patch) -> None:
    """It shows no cause: a rise that a cause may have is too much for it."""
    assert not worse_as_deployed(0.5, monkeypatch)
    fit = SimpleNamespace(model=None, equilibrium=SimpleNamespace(poses=None))
    form: Any = SimpleNamespace(is_free_form=True, depends_on=())

    def refused(before: object, after: object) -> bool:
        refit: Any = SimpleNamespace(fit=fit, blocks=after)
        return candidate_trial._worse_as_deployed([form], refit, before) is not None  # type: ignore[arg-type]

    assert refused(fallen(0.01, 0.5), squares())
    assert not refused(squares(), fallen(0.01, 0.5))
