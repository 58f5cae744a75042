"""Cards of the steps that were taken: what each found, how sure, how far the error fell, and what else it could be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from lrm_ident.data.wording import in_mm
from lrm_ident.diagnosis.contradiction import NoCause, why_no_cause
from lrm_ident.diagnosis.evidence import Evidence
from lrm_ident.report.plain_names import step_title
from lrm_ident.report.text.claims import in_words, outliers_left_out, stated, turned
from lrm_ident.report.text.variables import variable_name
from lrm_ident.residual.covariates import Covariate
from lrm_ident.residual.gravity_loads import LOCAL, usual_turns
from lrm_ident.residual.picture.error_field import ErrorField
from lrm_ident.residual.picture.group_means import explained_by_means, joints_of, of_law, shown_most
from lrm_math.arm.arm_file import MM
from lrm_math.effects import FREE_FORMS, Effect, EffectRef, Parameter, variants
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.model import Model
from lrm_math.model.model_file import HistoryTable, ModelFile

RIVALS_KEPT = 4
AS_WELL = 0.05
"""Share of an effect's error by which another that explains as much may leave more."""


@dataclass(frozen=True)
class StepCard:
    """Record of a step that was taken.

    Attributes:
        number: of the step in the history. name: `effect@place`, or the step's own. title: the same in plain words.
        adds: whether it added an effect; another fitted anew, and shows nothing.
        claim: the sentence with its estimates. estimate: the one number of an effect that has one, else "".
        estimates: all of them. joint: from 0, driver: name of the covariate, that its motion follows.
        evidence: for it. It only describes if it is a form of other effects, or these angles could not contradict its
            formula.
    """

    number: int
    name: str
    title: str
    adds: bool
    claim: str
    estimate: str
    estimates: tuple[str, ...]
    joint: int
    driver: str
    evidence: Evidence

    def unrivalled(self, after: float) -> bool:
        """Whether no other effect alone would have left about as little as was left `after` the step (mm, held out)."""
        if self.evidence.rivals is None or self.evidence.equivalent:
            return False
        return all(rival_error * 1e3 > (1.0 + AS_WELL) * after for rival_error in self.evidence.rivals.values())


def rivals(card: StepCard, weighted: bool) -> tuple[tuple[str, str], ...]:
    """The effects that came next to a step's own, and what each would have left, of steps that kept it.

    Those that are indistinguishable come first; ≈: not refitted. `weighted`: more than positions was measured, so that
    the screening's estimates, of all that was measured, are no errors of the tip.
    """
    rivals_left, free = card.evidence.rivals or {}, {kind.id for kind in FREE_FORMS}
    why = dict.fromkeys(card.evidence.equivalent, "these poses cannot distinguish it")
    for name, rival_error in rivals_left.items():
        exact = name in card.evidence.refitted
        size = f"{'' if exact else '≈ '}{in_mm(rival_error)} mm" if exact or not weighted else "not refitted"
        why[name] = f"{size}{', with more parameters' if EffectRef.parse(name).id in free else ''}"
    return tuple((name, words) for name, words in why.items() if name != card.name)[:RIVALS_KEPT]


def of_data(entry: HistoryTable, sha256: str) -> bool:
    """Whether a step's errors are of the data with this hash."""
    return entry.provenance is not None and entry.provenance.data_sha256 == sha256


def step_cards(
    file: ModelFile,
    models: Sequence[Model],
    field: ErrorField,
    covariates_known: Sequence[Covariate],
    rest: Equilibrium,
) -> Iterator[StepCard]:
    """A card for every step after the first. `covariates_known`: at the drawn poses. `rest`: of the model, at all."""
    constant = [covariate for covariate in covariates_known if covariate.kind not in LOCAL]
    effects = [{effect.name: effect for effect in model.effects} for model in models]
    for number, entry in enumerate(file.history[1:], start=1):
        added = [effect for name, effect in effects[number].items() if name not in effects[number - 1]]
        numbers = {name: words for effect in added for name, words in _estimates(effect, entry, {}).items()}
        free = sum(key in entry.sigma for effect in added for key in effect.keys)
        followed = of_law(added[0], covariates_known) if added else constant
        turns = usual_turns(added[0], rest) if len(added) == 1 else {}
        plain = _estimates(added[0], entry, turns) if len(added) == 1 else {}
        joint, driver = _shown(added[0].place if added else "", field, number, followed)
        yield StepCard(
            number=number,
            name=entry.name.added or str(entry.name),
            title=_capital(step_title(entry.name)),
            adds=bool(entry.name.added),
            claim=_claim(added, plain, turns) or _left_out(entry, file.history[number - 1]),
            estimate=_size(added[0], plain) + turned(bool(turns)) if free == 1 and plain else "",
            estimates=tuple(f"{estimate.symbol} = {words}" for estimate, words in numbers.items()),
            joint=joint,
            driver=driver,
            evidence=Evidence(
                tuple(entry.indistinguishable),
                rivals=None if entry.rivals_mm is None else {name: mm * MM for name, mm in entry.rivals_mm.items()},
                refitted=tuple(entry.rivals_refitted),
                of_present=any(name in effects[-1] for effect in added for name in variants(effect)),
                describes=any(why_no_cause(effect, rest.poses.q) is not NoCause.LITTLE for effect in added),
            ),
        )


def _shown(place: str, field: ErrorField, number: int, covariates_known: Sequence[Covariate]) -> tuple[int, str]:
    """The joint and the driver whose chart shows most of what a step took away; of an effect at a joint, that joint."""
    joints = joints_of(place, len(field.lever))
    before, after = field.steps[number - 1].turns, field.steps[number].turns
    taken = [
        explained_by_means(before, field.lever, covariate.values)
        - explained_by_means(after, field.lever, covariate.values)
        for covariate in covariates_known
    ]
    joint, driver = shown_most(taken, covariates_known, joints)
    return joint, variable_name(driver) if driver else ""


def _estimates(effect: Effect, entry: HistoryTable, turns: Mapping[str, float]) -> dict[Parameter, str]:
    """Numbers of an effect; none of what names no cause, of which none means anything alone. `turns`: `usual_turns`."""
    if not effect.names_a_cause:
        return {}
    return {
        parameter: in_words(parameter, entry.parameters[key], entry.sigma.get(key), turns.get(parameter.name))
        for key, parameter in zip(effect.keys, effect.parameters, strict=True)
        if key in entry.parameters
    }


def _size(effect: Effect, numbers: Mapping[Parameter, str]) -> str:
    """The first number of an effect, its sign in words."""
    parameter, words = next(iter(numbers.items()))
    return effect.about.sized(parameter.name, words)


def _claim(added: Sequence[Effect], numbers: Mapping[Parameter, str], turns: Mapping[str, float]) -> str:
    """The sentence of the effect that was added; nothing where several were."""
    if len(added) != 1 or not added[0].about.claim:
        return ""
    return _capital(stated(added[0], {p.name: numbers.get(p, "0") for p in added[0].parameters}, turns))


def _left_out(entry: HistoryTable, before: HistoryTable) -> str:
    """The poses that a step took for outliers, and what to do about them; empty where it left none out."""
    now, earlier = (() if step.provenance is None else step.provenance.left_out for step in (entry, before))
    poses = [pose for pose in now if pose not in earlier]
    return _capital(outliers_left_out(poses)) if poses else ""


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]
