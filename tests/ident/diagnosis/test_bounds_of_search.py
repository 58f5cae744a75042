"""How much a diagnosis tries, keeps and shows where there is more than its bounds on time and length allow."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lrm_ident.diagnosis import confirm, diagnose, effect_pairs, inject_recover, unexplained_structure
from lrm_ident.diagnosis.candidate_trial import CandidateTrial
from lrm_ident.diagnosis.effect_pairs import EffectPairs
from lrm_ident.diagnosis.inject_recover import InjectionPlan
from lrm_ident.diagnosis.screening import likely_shapes
from lrm_ident.diagnosis.screening.candidates import Candidate
from lrm_ident.diagnosis.screening.screen import rows_to_screen
from lrm_ident.diagnosis.symbolic_regression import proposal
from lrm_ident.diagnosis.unexplained_structure import UnexplainedStructure
from lrm_ident.fitting.identifiability import subsample_rows
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import CATALOGUE, ModelPart, effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from tests.ident.diagnosis.test_rules_of_refits import REFUSED, confirmed

MANY = 40
Patch = pytest.MonkeyPatch


def some(count: int = MANY) -> list[Any]:
    """Effects of the arm of which each predicts worse than the one before it."""
    effect = SimpleNamespace(part=ModelPart.ARM, is_free_form=False)
    return [
        SimpleNamespace(
            name=f"e{number}@x",
            implausible=None,
            candidate=SimpleNamespace(effect=effect, priority=0),
            alone=SimpleNamespace(rms=1.0 + number),
            projected=number,
        )
        for number in range(count)
    ]


def noting(into: list[str], answer: Any = None) -> Callable[..., Any]:
    """Stands for a refit of its second argument; writes down whose it is."""

    def refit(_: Any, one: Any, *__: Any) -> Any:
        into.append(one.name)
        return answer

    return refit


def refused_before_the_rest_is_left(patch: Patch, tried: list[str]) -> None:
    confirmed(patch, *[(0.5, REFUSED)] * 20, tried=tried)


def special_cases_refitted(patch: Patch, tried: list[str]) -> None:
    first, *smaller = some()
    patch.setattr(confirm, "refit_trial", noting(tried, CandidateTrial(None)))
    known: Any = SimpleNamespace(supported=(first,), special_cases=lambda: smaller)
    confirm._led_by_special_case(known, CandidateTrial(None), (), "")


def underrated_refitted(patch: Patch, tried: list[str]) -> None:
    first, *promising = some()
    patch.setattr(confirm.BoundedFit, "of", lambda _: SimpleNamespace(underrated=lambda *_: promising))
    known: Any = SimpleNamespace(
        supported=(first,), equivalent={first.name: ()}, screening=None, unexplained=SimpleNamespace(spurious={})
    )
    confirm._led_by_underrated(known, CandidateTrial(None), noting(tried, CandidateTrial(None)), np.ones(1), ())


def partners_sought(patch: Patch, tried: list[str]) -> None:
    """Of the best alone."""
    effects = some()
    pair = (effects[0], SimpleNamespace(rms=1.0))
    patch.setattr(EffectPairs, "_with_partner", lambda self, one: noting(tried, pair)(self, one))
    alone = {one.name: one.alone for one in effects}
    assert effect_pairs.EffectPairs(effects[::-1], None, None, alone)._pairs  # type: ignore[arg-type]
    assert tried == [one.name for one in effects[: len(tried)]]


def rivals_kept(_: Patch, tried: list[str]) -> None:
    known: Any = SimpleNamespace(scored=some()[::-1], error_of_tip=lambda rms, _: rms)
    rivals = diagnose.Diagnosis.rivals(known, (), 1.0)
    assert [*rivals.values()] == sorted(rivals.values())
    tried += rivals


def rounds_without_outliers(patch: Patch, tried: list[str]) -> None:
    """Where further ones come to light each time."""
    data: Any = SimpleNamespace(without=lambda _: data)
    screening = SimpleNamespace(outliers=(7,), fit=SimpleNamespace(model=None), data=data)
    again = SimpleNamespace(name="again")
    patch.setattr(diagnose, "screen", lambda *_: screening)
    patch.setattr(diagnose, "_fitted", lambda *_: noting(tried)(None, again))
    patch.setattr(diagnose, "replace", lambda of, **_: of)
    patch.setattr(diagnose, "_select", lambda of, _: of)
    patch.setattr(diagnose, "_shifted", lambda *_: ())
    fitted: Any = SimpleNamespace()
    diagnose.diagnose(None, data, fitted=fitted)  # type: ignore[arg-type]


def ranking_of_functions(patch: Patch) -> tuple[list[Any], list[Any]]:
    """The functions that are cross-validated, and those that are ranked: the likely ones, from the best."""
    likely: list[Any] = []

    def explained(of: list[Any], *_: Any) -> dict[Any, Any]:
        likely.extend(of)
        return {one: SimpleNamespace(rms=-one) for one in of}

    patch.setattr(unexplained_structure, "_explained", explained)

    class Size(int):
        size = 1

    functions = {Size(number): 1.0 + number for number in range(MANY)}
    of = UnexplainedStructure((), {}, functions, SimpleNamespace(residual=np.zeros(9)), None)  # type: ignore[arg-type]
    ranked = [function for function, _ in of.ranking]
    assert likely == [*range(len(likely))], "by Akaike's criterion"
    assert ranked == likely[::-1][: len(ranked)], "by the held-out error"
    return likely, ranked


def functions_cross_validated(patch: Patch, tried: list[str]) -> None:
    tried += ranking_of_functions(patch)[0]


def functions_ranked(patch: Patch, tried: list[str]) -> None:
    tried += ranking_of_functions(patch)[1]


def laws_added_up(patch: Patch, tried: list[str]) -> None:
    """Where each further one helps."""
    law = SimpleNamespace(error=None)
    for name in ("fit", "typical_prior", "cross_validated_residual", "error_stats"):
        patch.setattr(proposal, name, lambda *_, **__: SimpleNamespace(model=None))
    patch.setattr(proposal, "replace", lambda of, **_: of)

    def propose(*_: Any) -> Any:
        tried.append("law")
        return SimpleNamespace(best=law, equivalent=())

    patch.setattr(proposal, "_propose", propose)
    proposal.propose_law(None, None)  # type: ignore[arg-type]


def proposed(patch: Patch, tried: list[str]) -> Any:
    """A proposal where very many laws are one class, of which each refit helps."""
    laws = [SimpleNamespace(name=f"law {number}", formula="") for number in range(MANY)]
    search = SimpleNamespace(nested=np.zeros(9), p_value=0.0, laws=laws, squares=np.zeros((9, MANY)))
    linear = SimpleNamespace(baseline=SimpleNamespace(held_out=np.ones(9)))
    for name, answer in {
        "linearised": linear, "RowWeights": None, "law_columns": [], "search_laws": search, "predicts_better": True,
        "_equivalent": [(law, 1.0) for law in laws],
    }.items():  # fmt: skip
        patch.setattr(proposal, name, lambda *_, answer=answer: answer)

    def refit(law: Any, *_: Any) -> Any:
        tried.append(law.name)
        return SimpleNamespace(law=law, error=SimpleNamespace(rms=0.5))

    patch.setattr(proposal, "_refit", refit)
    fitted, before = SimpleNamespace(weight=None), SimpleNamespace(rms=1.0)
    data = SimpleNamespace(whitening=None)
    return proposal._propose(fitted, data, before, None, lambda *_: None, str)  # type: ignore[arg-type]


def laws_refitted(patch: Patch, tried: list[str]) -> None:
    assert proposed(patch, tried).best.law.name == tried[0]


def laws_of_its_class_shown(patch: Patch, tried: list[str]) -> None:
    tried += [law.name for law, _ in proposed(patch, []).equivalent]


def poses_that_tell_laws_apart(patch: Patch) -> tuple[int, int]:
    """How many are drawn, and how many of them are shown: those at which the laws move the tip farthest apart."""
    measured, rng = poses_of(np.zeros((9, 3))), np.random.default_rng(0)
    drawn: list[Any] = []
    own, rival = (SimpleNamespace(joint=0, name=name) for name in ("own", "rival"))

    def moved(law: Any, there: Any) -> Any:
        motion = np.ones((3 * len(there.poses), 1))
        if law is rival and there.poses is not measured:
            motion[:, 0] += there.apart.repeat(3)
        return motion

    def settled(_: Any, poses: Any) -> Any:
        drawn.append(SimpleNamespace(poses=poses, apart=rng.random(len(poses))))
        return drawn[0]

    patch.setattr(proposal, "law_id", lambda law: law.name)
    patch.setattr(proposal, "_moved", moved)
    patch.setattr(proposal, "solve_equilibrium", settled)
    model = SimpleNamespace(keys=("own.joint1.p",), value=lambda _: 1.0)
    best: Any = SimpleNamespace(law=own, fit=SimpleNamespace(model=model))
    fitted: Any = SimpleNamespace(model=None, equilibrium=SimpleNamespace(poses=measured))
    data: Any = SimpleNamespace(poses=measured, __len__=None)
    patch.setattr(proposal, "len", lambda of: 9 if of is data else len(of), raising=False)
    shown = proposal._separating_poses(best, [(rival, 1.0)], fitted, data)  # type: ignore[list-item]
    (there,) = drawn
    np.testing.assert_array_equal(shown, there.poses.q[np.argsort(-there.apart)[: len(shown)]])
    return len(there.poses), len(shown)


def poses_drawn(patch: Patch, tried: list[str]) -> None:
    tried += ["pose"] * poses_that_tell_laws_apart(patch)[0]


def poses_shown_next(patch: Patch, tried: list[str]) -> None:
    tried += ["pose"] * poses_that_tell_laws_apart(patch)[1]


def outliers_screened(_: Patch, tried: list[str]) -> None:
    """Beside the subsample, the farthest."""
    count = 5000
    beside = np.setdiff1d(np.arange(count), subsample_rows(count))
    fitted: Any = SimpleNamespace(residual=np.arange(3.0 * count).reshape(-1, 3), outliers=beside[:400])
    rows = np.setdiff1d(rows_to_screen(fitted), subsample_rows(count))
    np.testing.assert_array_equal(rows, beside[:400][-len(rows) :])
    tried += map(str, rows)


def poses_of_the_subsample(_: Patch, tried: list[str]) -> None:
    tried += map(str, subsample_rows(5000))


def shapes_kept(patch: Patch, count: int) -> tuple[Any, Any]:
    """A candidate of so many shapes, of which one is the likelier the earlier it stands, and what is tried of it."""
    poses = poses_of(np.zeros((5, 3)))
    effect = SimpleNamespace(targets=("joint1.theta",), load_slots=(), amounts=lambda *_: (np.ones(5),))
    model = SimpleNamespace(load_slots=(), chain=SimpleNamespace(index={"joint1.theta": 0}))
    settled = SimpleNamespace(model=model, tau=(), poses=poses)
    response = SimpleNamespace(equilibrium=settled, slots=np.ones((1, 3, 5)))
    patch.setattr(likely_shapes, "kind_of", lambda _: likely_shapes.Kind.MOTION)
    patch.setattr(likely_shapes, "_explained", lambda columns, *_: -np.arange(len(columns)))
    shapes = tuple((0.0, float(number)) for number in range(count))
    candidate = Candidate(effect, (0,), shapes, 0, response)  # type: ignore[arg-type]
    return candidate, likely_shapes.with_likely_shapes(candidate, np.ones((5, 3)))


def shapes_that_are_all_tried(patch: Patch, tried: list[str]) -> None:
    for count in range(1, MANY):
        candidate, kept = shapes_kept(patch, count)
        tried += ["shape"] * (kept is candidate)


def likely_shapes_tried(patch: Patch, tried: list[str]) -> None:
    tried += [str(number) for _, number in shapes_kept(patch, MANY)[1].shapes]


def neighbours_that_a_likely_shape_stands_for(patch: Patch, tried: list[str]) -> None:
    (_, first), (_, second), *_ = shapes_kept(patch, MANY)[1].shapes
    tried += ["shape"] * round(second - first - 1.0)


BOUNDS: dict[Callable[[Patch, list[str]], None], int] = {
    refused_before_the_rest_is_left: 8,
    special_cases_refitted: 2,
    underrated_refitted: 2,
    partners_sought: 4,
    rivals_kept: 4,
    rounds_without_outliers: 3,
    functions_cross_validated: 20,
    functions_ranked: 5,
    laws_added_up: 3,
    laws_refitted: 4,
    laws_of_its_class_shown: 12,
    poses_drawn: 2000,
    poses_shown_next: 5,
    outliers_screened: 200,
    poses_of_the_subsample: 2000,
    shapes_that_are_all_tried: 12,
    likely_shapes_tried: 4,
    neighbours_that_a_likely_shape_stands_for: 3,
}


@pytest.mark.parametrize(("work", "most"), BOUNDS.items(), ids=lambda one: getattr(one, "__name__", ""))
def test_no_more_is_done_than_a_bound_allows(
    work: Callable[[Patch, list[str]], None], most: int, monkeypatch: Patch
) -> None:
    done: list[str] = []
    work(monkeypatch, done)
    assert len(done) == most


def test_arms_of_a_selftest_are_as_wrong_as_it_says(monkeypatch: Patch) -> None:
    """Their other errors: Gaussian with 0.4 of the typical size, springs between 0.3 and 1."""
    drawn: list[float] = []
    signed: list[bool] = []

    def model_of(_: Any, effects: Any, values: dict[str, float]) -> None:
        for effect in effects:
            drawn.extend(values[key] / p.typical for key, p in zip(effect.keys, effect.parameters, strict=True))
            signed.extend([p.lower != 0.0 for p in effect.parameters])
        raise LrmError("no arm is needed")

    monkeypatch.setattr(inject_recover, "model_of", model_of)
    arm = load_arm("lrm-lab")
    plan = InjectionPlan("lrm-lab", poses_of(np.zeros((1, 6))), 0.0, 0, None)
    for kind in CATALOGUE:
        for place in kind.places(arm):
            assert inject_recover._trial(plan, arm, f"{kind.id}@{place}").outcome == "failed"
    sizes, both = np.array(drawn), np.array(signed)
    assert sizes[both].std() == pytest.approx(0.4, rel=0.05)
    assert sizes[~both].min() == pytest.approx(0.3, abs=0.02)
    assert sizes[~both].max() == pytest.approx(1.0, abs=0.02)


def test_what_repeats_an_effect_moves_the_tip_exactly_as_it_does() -> None:
    """A second shift without a first one does; what is nearly alike is another effect."""
    once, again = (
        effects_at(load_arm("lrm-lab"), f"{kind}@joint2")[0] for kind in ("change_point", "second_change_point")
    )
    for off, repeats in ((0.0, True), (0.1, False)):
        scored = [
            SimpleNamespace(name=effect.name, size=1, candidate=SimpleNamespace(effect=effect), orthonormal=basis)
            for effect, basis in ((once, [[1.0], [0.0]]), (again, [[np.cos(off)], [np.sin(off)]]))
        ]
        for one in scored:
            one.orthonormal = np.array(one.orthonormal)
        known: Any = SimpleNamespace(scored=scored)
        found = diagnose.Diagnosis.repetitions(known, scored[0])  # type: ignore[arg-type]
        assert found == ([again.name] if repeats else [])
