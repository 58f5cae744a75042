"""Rules by which refits, halves, rows, later poses and measured angles decide, one case on either side of each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from inspect import signature
from itertools import product, repeat
from pathlib import Path
from string import ascii_lowercase
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lrm_ident as lrm
from lrm_ident.cli import diagnosis as command
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis import auto, candidate_trial, confirm, replication
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.diagnosis.companion import improves_beside
from lrm_ident.diagnosis.contradiction import NoCause, can_be_contradicted, levels_of_its_own, why_no_cause
from lrm_ident.diagnosis.inject_recover import InjectionTrial
from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.diagnosis.nested_cross_validation import nested_held_out
from lrm_ident.diagnosis.reason import Reason, ReasonKind
from lrm_ident.diagnosis.shifted_rows import ShiftedRows, shifted_rows
from lrm_ident.diagnosis.step import Step
from lrm_ident.fitting.held_out import HeldOutBlock
from lrm_ident.residual.deployment.rolling_origin import (
    Forecasts,
    allows_rolling_origin,
    changes_too_late,
    rolling_origin_forecasts,
)
from lrm_ident.study.parameter_estimates import parameter_estimates
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import ModelPart, effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.step_name import ADD, StepName
from validation.as_deployed.worlds import OngoingCase

POSES = 40
Patch = pytest.MonkeyPatch


def scored(name: str, alone: float = 1.0, part: ModelPart = ModelPart.ARM) -> Any:
    """A candidate that alone leaves so much of the mean square."""
    effect = SimpleNamespace(is_free_form=False, variant_of=(), depends_on=("q",), name=name, part=part)
    candidate = SimpleNamespace(effect=effect, priority="")
    return SimpleNamespace(
        name=name, implausible=None, candidate=candidate, alone=SimpleNamespace(held_out=np.full(POSES, alone))
    )


REFUSED = None


def confirmed(
    patch: Patch,
    *candidates: tuple[float, float | None],
    again: tuple[str, ...] = (),
    tried: list[str] | None = None,
    **options: Any,
) -> Any:
    """A diagnosis of effects a, b, …: the mean squares that each alone would leave, and that its refit leaves.

    `again`: those that repeat the first one. `tried`: takes the names of those that are refitted. `options`: of
    `confirm`.
    """
    effects = [scored(name, alone) for name, (alone, _) in zip(ascii_lowercase, candidates, strict=False)]

    def diagnosis(*supported: Any) -> Any:
        screening = SimpleNamespace(linear=SimpleNamespace(baseline=SimpleNamespace(held_out=np.ones(POSES))))
        return SimpleNamespace(
            supported=supported,
            screening=screening,
            special_cases=list,
            repetitions=lambda one: again if one is effects[0] else (),
        )

    def trial(left: float | None) -> candidate_trial.CandidateTrial:
        if left is REFUSED:
            return candidate_trial.CandidateTrial(None, Reason(ReasonKind.NEAR_ZERO))
        return candidate_trial.CandidateTrial(SimpleNamespace(squares=np.full(POSES, left)))  # type: ignore[arg-type]

    trials = {one.name: trial(left) for one, (_, left) in zip(effects, candidates, strict=True)}

    def refitted(_: Any, one: Any, *__: Any) -> candidate_trial.CandidateTrial:
        if tried is not None:
            tried.append(one.name)
        return trials[one.name]

    patch.setattr(confirm, "held_out_squares", lambda _: np.ones(POSES))
    patch.setattr(confirm, "refit_trial", refitted)
    patch.setattr(confirm, "_led_by_underrated", lambda diagnosis, trial, *_: (diagnosis, trial, {}))
    patch.setattr(
        confirm, "select_without", lambda _, names: diagnosis(*(one for one in effects if one.name not in names))
    )
    return confirm.confirm(diagnosis(*effects), ("blocks",), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "before",
    [
        [(0.5, REFUSED)],
        [(0.5, REFUSED), (0.9, REFUSED)],  # the largest promise counts, not the last one
    ],
)
def test_an_effect_that_saves_far_less_than_a_refused_one_promised_is_refused(
    monkeypatch: Patch, before: list[tuple[float, float | None]]
) -> None:
    """It has to save half of that: 0.25."""
    last = "abc"[len(before)]
    found = confirmed(monkeypatch, *before, (1.0, 0.8))
    assert found.supported == ()
    assert found.refused[last] == Reason(ReasonKind.LESS_THAN_PROMISED, names=("a",))
    found = confirmed(monkeypatch, *before, (1.0, 0.7))
    assert [one.name for one in found.supported] == [last]
    assert last not in found.refused


def test_after_one_that_saves_far_less_no_other_is_tried(monkeypatch: Patch) -> None:
    found = confirmed(monkeypatch, (0.5, REFUSED), (1.0, 0.8), (1.0, 0.1))
    assert (found.supported, set(found.refused)) == ((), {"a", "b"})


def test_what_repeats_a_refused_effect_is_refused_with_it(monkeypatch: Patch) -> None:
    """It has a refit that would be taken, and none is tried."""
    found = confirmed(monkeypatch, (0.5, REFUSED), (0.5, 0.3), again=("b",))
    assert (found.supported, found.refused["b"]) == ((), found.refused["a"])


DOUBT = {"a": Reason(ReasonKind.WORSE_DEPLOYED)}
"""Why effect a was refused at an earlier step."""


def test_an_effect_refused_as_deployed_before_is_not_refitted_where_another_is_confirmed(monkeypatch: Patch) -> None:
    """Its refit would be taken, and costs what that of any other does. It promises as much as if refused anew."""
    tried: list[str] = []
    found = confirmed(monkeypatch, (0.5, 0.3), (1.0, 0.7), doubted=DOUBT, tried=tried)
    assert (found.supported[0].name, tried) == ("b", ["b"])
    assert found.refused == found.refused_as_deployed == DOUBT
    assert confirmed(monkeypatch, (0.5, REFUSED), (1.0, 0.8), doubted=DOUBT).supported == ()


def test_it_is_refitted_before_nothing_is_confirmed(monkeypatch: Patch) -> None:
    """Each refit is made once."""
    tried: list[str] = []
    found = confirmed(monkeypatch, (0.5, 0.3), (1.0, REFUSED), doubted=DOUBT, tried=tried)
    assert (found.supported[0].name, tried, found.refused) == ("a", ["b", "a"], {})
    tried.clear()
    found = confirmed(monkeypatch, (0.5, REFUSED), (1.0, REFUSED), doubted=DOUBT, tried=tried)
    assert (found.supported, tried) == ((), ["b", "a"])
    assert {reason.kind for reason in found.refused.values()} == {ReasonKind.NEAR_ZERO}, "as it is beside all others"


def test_the_effect_beside_which_the_last_one_was_added_is_refitted(monkeypatch: Patch) -> None:
    """Alone it was refused as deployed; of the two together it is known that they are better."""
    assert confirmed(monkeypatch, (0.5, 0.3), (1.0, 0.3), doubted=DOUBT, tested="a").supported[0].name == "a"


@pytest.mark.parametrize(("most", "doubts"), [(3, [{}, DOUBT, DOUBT, {}]), (9, [{}, DOUBT, DOUBT, DOUBT])])
def test_doubts_go_on_from_step_to_step_but_not_to_the_last(
    most: int, doubts: list[dict[str, Reason]], monkeypatch: Patch
) -> None:
    """What is said of the last step is found beside all effects."""
    assert auto_run(monkeypatch, "bcd", most)[1] == doubts


def auto_run(patch: Patch, names: Iterable[str], *most: int) -> tuple[int, list[Any]]:
    """How many effects `auto` adds, if a diagnosis confirms these, and the doubts that each diagnosis is told of."""
    known: list[Any] = []
    names = iter(names)
    rows: Any = SimpleNamespace(pose=np.arange(POSES))
    step = SimpleNamespace(fit=SimpleNamespace(model=None), blocks=())

    def confirmed_next(*_: Any, doubted: Any = MappingProxyType({}), **__: Any) -> Any:
        known.append(doubted)
        name = next(names, None)
        return SimpleNamespace(
            first=name and SimpleNamespace(name=name),
            refit=step,
            beside="",
            blocks=(),
            diagnosis=SimpleNamespace(data=rows),
            refused_as_deployed=DOUBT if len(known) == 1 else {},
        )

    patch.setattr(auto, "confirm", confirmed_next)
    patch.setattr(auto, "diagnose", lambda *_: SimpleNamespace(data=rows))
    for function in ("_start", "_step", "_evidence"):
        patch.setattr(auto, function, lambda *_: step)
    patch.setattr(auto, "_with_candidates", lambda run: run)
    nothing: Any = None
    return len(auto.run_auto(nothing, rows, *most).steps) - 1, known


def test_twenty_effects_are_added_at_most_through_every_door(monkeypatch: Patch) -> None:
    """Unless another number is asked for."""
    assert auto_run(monkeypatch, repeat("b"))[0] == 20
    assert auto_run(monkeypatch, repeat("b"), 3)[0] == 3
    for door in (Study.auto, Study.nested_held_out, lrm.auto, nested_held_out, command.auto):
        assert signature(door).parameters["max_effects"].default == 20, door


def leading(
    patch: Patch, large: tuple[float, float], small: tuple[float, float], part: ModelPart = ModelPart.ARM
) -> str:
    """Which leads, the effect or a special case of it, by the squares that each leaves refitted, in the
    session and as deployed."""

    def refit(left: float, deployed: float) -> candidate_trial.Refit:
        residual, carried = (np.full((POSES, 3), np.sqrt(each / 3)) for each in (left, deployed))
        block = HeldOutBlock(np.arange(0), np.arange(POSES), residual[:0], residual, deployed_residual=carried)
        return candidate_trial.Refit(SimpleNamespace(), (block,))  # type: ignore[arg-type]

    first, member = scored("large", part=part), scored("small", part=part)
    trials = {
        "large": candidate_trial.CandidateTrial(refit(*large)),
        "small": candidate_trial.CandidateTrial(refit(*small)),
    }
    patch.setattr(confirm, "refit_trial", lambda _, one, *__: trials[one.name])
    diagnosis: Any = SimpleNamespace(
        supported=(first,),
        special_cases=lambda: [member],
        led_by=lambda other, members: SimpleNamespace(supported=(other,), members=members),
        equivalent={"large": ("small", "twin")},
    )
    led, trial, others = confirm._led_by_special_case(diagnosis, trials["large"], (), "")
    name = led.supported[0].name
    assert trial is trials[name]
    assert [*others] == [other for other in trials if other != name]
    assert name == "large" or led.members == ("large", "small", "twin")
    return name


def test_a_special_case_leads_where_it_predicts_no_worse(monkeypatch: Patch) -> None:
    assert leading(monkeypatch, (0.5, 0.6), (0.5, 0.6)) == "small"
    assert leading(monkeypatch, (0.5, 0.6), (0.51, 0.6)) == "large"
    assert leading(monkeypatch, (0.5, 0.6), (0.5, 0.61)) == "large"


def test_of_two_errors_of_the_tracker_the_session_decides(monkeypatch: Patch) -> None:
    """The points that it moved lie further from the arm, the more of that is the tracker's."""
    assert leading(monkeypatch, (0.5, 0.6), (0.5, 0.9), ModelPart.MEASUREMENT) == "small"
    assert leading(monkeypatch, (0.5, 0.6), (0.51, 0.6), ModelPart.MEASUREMENT) == "large"


def fitted(at_bound: tuple[str, ...] = ()) -> Any:
    """A fit of two parameters, each ten standard errors off zero."""
    keys = ("a.x.p", "b.x.p")
    parameter = SimpleNamespace(si=1.0, unit="mm")
    model = SimpleNamespace(free=keys, value=lambda _: 10.0, parameter=lambda _: parameter)
    return SimpleNamespace(
        model=model, at_bound=at_bound, standard_error=np.ones(2), correlation=np.eye(2), told=np.array([0.5, 0.5])
    )


def test_a_parameter_at_its_bound_is_no_evidence() -> None:
    assert candidate_trial.wald_p_value(fitted(), ["a.x.p"]) < 1e-9
    assert candidate_trial.wald_p_value(fitted(("a.x.p",)), ["a.x.p"]) == 1.0


def test_of_a_parameter_at_its_bound_neither_error_nor_share_of_the_data_is_stated() -> None:
    bound, inside = parameter_estimates(fitted(("a.x.p",))).values()
    assert (bound.standard_error, bound.from_data) == (None, None)
    assert (inside.standard_error, inside.from_data) == (1.0, 0.5)


def test_an_estimate_that_was_absurd_before_is_no_objection(monkeypatch: Patch) -> None:
    old, new = (SimpleNamespace(key=key) for key in ("old", "new"))
    monkeypatch.setattr(candidate_trial, "implausible_of", lambda fit: fit)
    monkeypatch.setattr(candidate_trial, "wald_p_value", lambda *_: 0.0)
    assert candidate_trial.objection_to_estimates((old,), (), (old,)) is None  # type: ignore[arg-type]
    absurd = candidate_trial.objection_to_estimates((old, new), (), (old,))  # type: ignore[arg-type]
    assert absurd == Reason(ReasonKind.ABSURD, subject=new)  # type: ignore[arg-type]


def test_an_error_that_is_said_is_that_of_the_tip_in_mm() -> None:
    """Whatever weights the comparison has."""
    residual = np.full((POSES, 3), 1e-3)
    block = HeldOutBlock(np.arange(0), np.arange(POSES), residual[:0], residual, weighted=100.0 * residual)
    objection = candidate_trial.objection_to_prediction([block], [block])
    assert objection.kind == ReasonKind.NOT_BETTER
    assert objection.numbers == pytest.approx([np.sqrt(3) * 1e-3] * 2)


@pytest.mark.parametrize(
    ("verdict", "named", "outcome"),
    [(None, (), "failed"), (Verdict.NOTHING_MISSING, (), "missed"), (Verdict.EFFECT_MISSING, ("b",), "wrong"),
     (Verdict.EFFECT_MISSING, ("a",), "found"), (Verdict.EFFECT_MISSING, ("a", "b"), "one of a class")],
)  # fmt: skip
def test_outcome_of_an_injected_effect(verdict: Verdict | None, named: tuple[str, ...], outcome: str) -> None:
    assert InjectionTrial("a", 1e-3, verdict, named).outcome == outcome


@pytest.mark.parametrize("wrong", [1, 2])
def test_one_row_alone_is_no_shifted_block(wrong: int) -> None:
    true = np.arange(30.0).reshape(10, 3)
    measured = true.copy()
    measured[4 : 4 + wrong] = true[3 : 3 + wrong]
    found = shifted_rows(np.arange(10), measured, true, 0.5)
    assert found == ((ShiftedRows(4, 5, 1),) if wrong == 2 else ())


def halves_of(depends_on: tuple[str, ...], patch: Patch) -> list[Any]:
    patch.setattr(replication, "held_out_folds", lambda _: np.arange(POSES) % 4)
    data = SimpleNamespace(poses=SimpleNamespace(direction=np.zeros((POSES, 6))), pose=np.arange(POSES))
    one = SimpleNamespace(candidate=SimpleNamespace(effect=SimpleNamespace(depends_on=depends_on)))
    return list(replication._halves(SimpleNamespace(subset=(None, data)), one))  # type: ignore[arg-type]


def test_what_depends_on_time_is_not_asked_of_the_first_half_of_the_session(monkeypatch: Patch) -> None:
    assert len(halves_of(("q",), monkeypatch)) == 2
    assert len(halves_of(("time",), monkeypatch)) == 1


def chosen(own: tuple[float, float], rival: tuple[float, float]) -> bool:
    """Whether a candidate replicates that leaves so much of each half, beside a rival that leaves so much."""
    halves = (np.arange(POSES // 2), np.arange(POSES // 2, POSES))
    ripple = 0.01 * np.where(np.arange(POSES) % 2, 1.0, -1.0)

    def estimate(left: tuple[float, float], sign: float = 1.0) -> Any:
        return SimpleNamespace(squares=np.repeat(left, POSES // 2) + sign * ripple)

    one, other = "own", "rival"
    estimates = {one: estimate(own), other: estimate(rival)}
    bounded: Any = SimpleNamespace(
        baseline=estimate((1.0, 1.0), -1.0),
        from_poses=lambda _: bounded,
        explain_each=lambda found: [estimates[name] for name in found],
    )
    return replication._chosen(bounded, halves, one, [other])  # type: ignore[arg-type, list-item]


def test_a_cause_replicates_where_it_helps_in_both_halves() -> None:
    assert chosen((0.5, 0.5), (1.0, 1.0))
    assert not chosen((0.5, 1.1), (2.0, 2.0))


@pytest.mark.parametrize("errors", [0.7, 1.3])
def test_it_helps_by_a_standard_error_in_each_half(errors: float) -> None:
    saved = errors * 0.02 / np.sqrt(POSES // 2)
    assert chosen((0.5, 1.0 - saved), (2.0, 2.0)) is (errors > 1.0)


def test_a_rival_that_is_better_in_one_half_contradicts_it() -> None:
    assert not chosen((0.5, 0.5), (1.0, 0.2))


def test_the_rivals_of_a_step_are_none_of_its_class() -> None:
    asked: list[list[str]] = []
    diagnosis = SimpleNamespace(
        equivalent={"one": ("twin",)},
        rivals=lambda taken, before, refitted: asked.append(taken) or {"near": refitted["near"], "far": before},
    )
    left = np.full((POSES, 3), 1.0 / np.sqrt(3.0))
    blocks = (HeldOutBlock(np.arange(0), np.arange(POSES), left[:0], left),)
    refits: Any = dict.fromkeys(["near", "twin"], SimpleNamespace(error=SimpleNamespace(rms=0.5)))
    one = scored("one")
    refused = {"no": Reason(ReasonKind.NEAR_ZERO)}
    before = confirm.ConfirmedDiagnosis(diagnosis, blocks, None, (one,), refused, refits=refits)  # type: ignore[arg-type]
    shown: Any = SimpleNamespace(
        diagnosis=diagnosis,
        explained=0.75,
        share=0.5,
        describes=False,
        replicates=True,
        rivals=before.rivals,
        refits=refits,
    )
    evidence = auto._evidence(shown, one)
    fit: Any = None
    step = Step(StepName(ADD, "one"), fit, fit, evidence=evidence)
    assert asked == [["one", "twin", "no"]], "what a refit refused is none either"
    assert step.names == ("one", "twin")
    assert step.evidence.rivals == pytest.approx({"near": 0.5, "far": 1.0})
    assert step.evidence.refitted == ("near",), "the other is an estimate of the screening"


@pytest.mark.long
@pytest.mark.parametrize(
    ("world", "effect"),
    [
        ("catalogue/first/slip4/80/0", "change_point@joint4"),
        ("catalogue/second/creep2/report/80/0", "creep@joint2"),
    ],
)
def test_what_goes_on_predicts_later_poses(world: str, effect: str, tmp_path: Path) -> None:
    data, _ = OngoingCase.of(world).record().load(tmp_path)
    study = Study.of(data).fit()
    plain = study.step.fit
    [one] = effects_at(plain.model.arm, effect)
    named = add_effects(plain.model, study.data, [one])
    assert named.sigma < plain.sigma
    assert allows_rolling_origin(study.data)
    assert len(rolling_origin_forecasts(named, study.data).best) == len(study.data) / 4
    assert candidate_trial._not_better_later([one], plain, named, study.data) is None


@pytest.mark.long
@pytest.mark.parametrize(
    ("world", "effect", "shown"),
    [
        ("catalogue/second/bending2/blind/80/0", "creep@base", False),
        ("catalogue/second/creep2/report/80/0", "creep@joint2", True),
    ],
)
def test_a_memory_shows_only_where_a_spring_does_not_fit_as_well(
    world: str, effect: str, shown: bool, tmp_path: Path
) -> None:
    """A link that bends, measured every 56 s, was called creep of the base with a time constant of 17 s."""
    data, _ = OngoingCase.of(world).record().load(tmp_path)
    study = Study.of(data).fit()
    [one] = effects_at(study.model.arm, effect)
    named = add_effects(study.taken.fit.model, study.data, [one])
    assert candidate_trial._shows_no_memory(one, named, study.data) is not shown


def judged(
    patch: Patch,
    without: Array,
    with_it: Array,
    depends_on: str = "time",
    part: object = ModelPart.ARM,
    followed: Array | None = None,
) -> bool:
    """Whether there is an objection to an effect with these forecasts, squared errors (M,).

    `followed`: those of its law where a rover follows it; None: the same.
    """
    patch.setattr(candidate_trial, "allows_rolling_origin", lambda _: True)
    patch.setattr(candidate_trial, "changes_too_late", lambda *_: False)
    patch.setattr(candidate_trial, "rolling_origin_forecasts", lambda fitted, _: fitted.forecasts)
    effect: Any = SimpleNamespace(depends_on=(depends_on,), part=part)
    forecasts = (Forecasts(without, without), Forecasts(with_it if followed is None else followed, with_it))
    fits: list[Any] = [SimpleNamespace(forecasts=one, model=None) for one in forecasts]
    nothing: Any = None
    return candidate_trial._not_better_later([effect], *fits, nothing) is not None


@pytest.mark.parametrize(("step", "late"), [(24.0, False), (25.0, False), (26.0, True), (31.0, True)])
def test_a_change_needs_ten_poses_behind_it_to_be_forecast(step: float, late: bool) -> None:
    """Of 40 poses, the last five are forecast last."""
    [effect] = effects_at(load_arm("so101"), "change_point@tool")
    model: Any = SimpleNamespace(value=lambda _: step)
    poses, number = poses_of(np.zeros((40, 5))), np.arange(1, 41)
    data = Measurements.of_tcp(replace(poses, number=number), np.zeros((40, 3)), pose=number)
    assert changes_too_late(effect, model, data) is late


def test_a_gain_within_its_spread_is_not_shown(monkeypatch: Patch) -> None:
    rng = np.random.default_rng(0)
    one, other = 1.0 + 0.3 * rng.random((2, 200))
    assert judged(monkeypatch, one, other)
    assert judged(monkeypatch, 0.8 * one, other)
    assert not judged(monkeypatch, one, 0.8 * other)


def test_a_law_that_is_wrong_later_is_refused_however_well_its_state_predicts(monkeypatch: Patch) -> None:
    rng = np.random.default_rng(0)
    one, other = 1.0 + 0.3 * rng.random((2, 200))
    assert not judged(monkeypatch, one, 0.8 * other, followed=0.9 * other)
    assert judged(monkeypatch, one, 0.8 * other, followed=1.2 * other)


def test_what_forecasts_cannot_judge_is_left_to_the_cross_validation(monkeypatch: Patch) -> None:
    """A change after the last poses that forecasts are fitted to; what is no effect of a session; a tracker."""
    same = np.ones(200)
    assert not judged(monkeypatch, same, same * (1.0 + 1e-6))
    worse = 2.0 * same
    assert judged(monkeypatch, same, worse)
    assert not judged(monkeypatch, same, worse, depends_on="angle")
    assert not judged(monkeypatch, same, worse, part=ModelPart.MEASUREMENT)


@pytest.mark.long
def test_two_that_hide_each_other_are_confirmed_together(tmp_path: Path) -> None:
    """A tracker's scale and a screw that slipped: neither alone makes the deployed model surely better."""
    data, _ = OngoingCase.of("catalogue/pair/stretched+slip2/80/0").record().load(tmp_path)
    found = confirm.confirm(Study.of(data).fit().screen())
    assert found.first.name == "change_point@joint2"
    assert found.beside == "measurement_frame@frame"
    assert not found.refused
    scored = {one.name: one for one in found.diagnosis.scored}
    assert improves_beside(found.refit.fit, data, scored["measurement_frame@frame"])
    assert not improves_beside(found.refit.fit, data, scored["drift@joint2"]), "it helps only without the first"
    assert found.diagnosis.repetitions(found.first) == ["second_change_point@joint2"]


LAB = load_arm("lrm-lab")
GAIN, GEAR, COUPLED = (
    effects_at(LAB, name)[0] for name in ("servo_gain@joint2", "eccentricity@joint2", "coupling@joint4<-joint2")
)


def grid(levels: int) -> Array:
    """Every combination of so many angles of joints 2 and 4 (rad); the others at random."""
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (levels**2, LAB.dof))
    q[:, [1, 3]] = [*product(np.linspace(-1.0, 1.0, levels), repeat=2)]
    return q


@given(st.integers(2, 9))
def test_a_formula_needs_two_levels_more_than_it_has_parameters(levels: int) -> None:
    """One goes to the offset; with no other left any function of the angle fits exactly, and no name is shown."""
    for effect in (GAIN, GEAR, COUPLED):
        assert can_be_contradicted(effect, grid(levels)) == (levels >= len(effect.parameters) + 2)


@given(st.integers(0, 2**31), st.floats(-2.0, 2.0), st.integers(2, 6))
def test_joints_that_move_together_show_no_cause(seed: int, slope: float, other: int) -> None:
    """Functions of the one are functions of the other; where both move freely, each can be told."""
    q = np.random.default_rng(seed).uniform(-1.0, 1.0, (100, LAB.dof))
    joint = other % LAB.dof
    if joint == 1:
        return
    assert levels_of_its_own(q, 1) > 10
    q[:, 1] = slope * q[:, joint] + 0.2
    assert levels_of_its_own(q, 1) <= 2
    assert not can_be_contradicted(GEAR, q)


def test_only_a_formula_that_angles_could_contradict_fails_for_its_size_alone() -> None:
    """A free form stands for any of several effects, unless the model has one of them: then it is its other form."""
    curve = effects_at(LAB, "angle_curve@joint2")[0]
    assert why_no_cause(GEAR, grid(9)) is NoCause.LITTLE
    assert why_no_cause(GEAR, grid(2)) is NoCause.FEW_ANGLES
    assert why_no_cause(curve, grid(9), ["backlash@joint2"]) is NoCause.FREE_FORM
    assert why_no_cause(curve, grid(9), [GAIN.name]) is NoCause.OTHER_FORM


def test_what_follows_no_single_angle_is_not_judged_by_angles() -> None:
    """Play and springs show themselves in the load and in the side of arrival."""
    for name in ("backlash@joint2", "compliance@joint2", "common_gain", "base_compliance@base"):
        assert can_be_contradicted(effects_at(LAB, name)[0], grid(2))
