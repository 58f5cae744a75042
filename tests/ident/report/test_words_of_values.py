"""Every kind of a value has words, and these are its own: the one place where a test compares sentences."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest

from lrm_ident.data.error_stats import ErrorStats
from lrm_ident.diagnosis.reason import Reason, ReasonKind
from lrm_ident.diagnosis.symbolic_regression.proposal import NoLaw
from lrm_ident.report.diagnosis.course import error_raised_on_the_arm, laws_that_may_be_wrong
from lrm_ident.report.document import Document, stated
from lrm_ident.report.fit import deployed_rows
from lrm_ident.report.text.poses import limitation_sentence
from lrm_ident.report.text.reasons import NO_LAW, reason_words
from lrm_ident.report.text.residuals import error_raised_sentence, hint_sentence, scale_sentence
from lrm_ident.report.text.variables import what_may_change
from lrm_ident.residual.covariates import ExplanatoryVariable, Kind
from lrm_ident.residual.data_audit import Limitation, LimitationKind
from lrm_ident.residual.deployment.deployed_error import DeployedError
from lrm_ident.residual.free_functions import CommonMode, FreeFunction
from lrm_ident.residual.parameter_hints import HintKind, ParameterHint
from lrm_ident.residual.scale_uncertainty import ScaleUncertainty
from lrm_ident.study.notices import Notice, NoticeKind
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.model.covariance import ImplausibleEstimate
from lrm_math.model.session_state import SessionMemory, StateAfterSession

FUNCTION = FreeFunction(2, (ExplanatoryVariable("angle", 0),), ())
ABSURD = ImplausibleEstimate("a.b.c_mm", 5.0, 1.0, "mm")
REASONS = {
    ReasonKind.IMPLAUSIBLE: (
        Reason(ReasonKind.IMPLAUSIBLE, (-0.5,), ("k_rad",)),
        "k_rad would have to be -0.5, against",
    ),
    ReasonKind.LITTLE: (Reason(ReasonKind.LITTLE, (9e-4, 1e-3)), "it would leave 0.90 of 1.00 mm held out"),
    ReasonKind.RESEMBLES: (
        Reason(ReasonKind.RESEMBLES, subject=FUNCTION),
        "it only resembles a free function of the angle of joint 1 at joint 3, which explains far more",
    ),
    ReasonKind.REFUSED: (
        Reason(ReasonKind.REFUSED, (2e-3,), because=Reason(ReasonKind.CHANCE)),
        "alone it would leave 2.00 mm, but that may be chance",
    ),
    ReasonKind.ABSURD: (Reason(ReasonKind.ABSURD, subject=ABSURD), f"refitted, {ABSURD.sentence}"),
    ReasonKind.NOT_REFITTED: (Reason(ReasonKind.NOT_REFITTED, said="X"), "it could not be refitted: X"),
    ReasonKind.NOT_BETTER: (
        Reason(ReasonKind.NOT_BETTER, (2e-3, 1e-3)),
        "refitted, it does not surely predict better: 2",
    ),
    ReasonKind.NOT_BETTER_LATER: (
        Reason(ReasonKind.NOT_BETTER_LATER, (1e-3, 2e-3)),
        "it fits this session, but from earlier poses it does not surely predict the later ones better: 1.00 mm as dep",
    ),
    ReasonKind.LESS_THAN_PROMISED: (
        Reason(ReasonKind.LESS_THAN_PROMISED, names=("b@c",)),
        "it saves far less than b@c promised, which its refit refused",
    ),
    ReasonKind.HARDLY_MOVES: (Reason(ReasonKind.HARDLY_MOVES, (1e-5,)), "a typical size moves the TCP by only 0.01 mm"),
    ReasonKind.POSES: (Reason(ReasonKind.POSES, said="no joint reversed"), "no joint reversed"),
}
"""Of the kinds that have numbers, names or a subject; each with how its sentence begins."""


@pytest.mark.parametrize("kind", [kind for kind in ReasonKind if kind != ReasonKind.EXPLAINS])
def test_every_kind_of_reason_has_its_sentence(kind: ReasonKind) -> None:
    reason, begins = REASONS.get(kind, (Reason(kind), ""))
    words = reason_words(reason)
    assert words.startswith(begins)
    others = [reason_words(REASONS.get(other, (Reason(other), ""))[0]) for other in ReasonKind if other not in
              (kind, ReasonKind.EXPLAINS)]  # fmt: skip
    assert words not in others


def test_every_refusal_of_a_law_has_its_sentence() -> None:
    assert NO_LAW.keys() == {*NoLaw}
    assert len({*NO_LAW.values()}) == len(NoLaw)


@pytest.mark.parametrize(
    ("limitation", "words"),
    [
        (
            Limitation(LimitationKind.FEW_ANGLES, (1, 2, 3), (2, 4)),
            "few angles: 2 to 4 different ones at each of joints 1 to 3, ",
        ),
        (
            Limitation(LimitationKind.FEW_ANGLES, (2,), (3, 3)),
            "few angles: 3 different ones at joint 2, so different causes",
        ),
        (
            Limitation(LimitationKind.ORDER, (1,), (0.94,)),
            "order: measured in the order of joint 1 (correlation 0.94), so drift looks the same",
        ),
        (
            Limitation(LimitationKind.NO_REVERSAL, (1, 4)),
            "no reversal: joints 1 and 4 always came from one side, so friction",
        ),
        (
            Limitation(LimitationKind.ONE_SIDED, (2, 3)),
            "one-sided torque: gravity loads joints 2 and 3 to one side, so",
        ),
        (Limitation(LimitationKind.ONE_LOAD), "one load: stiffness, backlash and mass look alike"),
    ],
)
def test_every_limitation_has_its_sentence(limitation: Limitation, words: str) -> None:
    assert limitation_sentence(limitation).startswith(words)


@pytest.mark.parametrize(
    ("hint", "words"),
    [
        (ParameterHint(HintKind.SCALED_LENGTHS, (0.008, 1e-4)), "all lengths are 0.800 ± 0.010 % longer than drawn, "),
        (
            ParameterHint(HintKind.SCALED_LENGTHS, (-0.008, 1e-4)),
            "all lengths are 0.800 ± 0.010 % shorter than drawn, ",
        ),
        (
            ParameterHint(HintKind.TURNED_FRAME, (0.0174533,)),
            "the base's offsets look like a frame turned by 1.00° about",
        ),
        (
            ParameterHint(HintKind.FEW_LEVELS, (3,), ("joint2", "servo_gain", "eccentricity")),
            "servo_gain and eccentricity of joint 2 rest on 3 levels of the joint: at others it may err differently",
        ),
    ],
)
def test_every_hint_has_its_sentence(hint: ParameterHint, words: str) -> None:
    assert hint_sentence(hint).startswith(words)


def test_for_machines_values_stand_beside_their_sentence() -> None:
    few = Limitation(LimitationKind.FEW_ANGLES, (1, 2), (2, 4))
    turned = ParameterHint(HintKind.TURNED_FRAME, (0.02,))
    values = {"audit": stated([few], limitation_sentence), "hints": stated([turned], hint_sentence)}
    told = json.loads(Document([], "lrm/diagnosis/1", values).json())
    said = {"sentence": limitation_sentence(few)}
    assert told["audit"] == [{"kind": "few_angles", "joints": [1, 2], "numbers": [2, 4], **said}]
    said = {"sentence": hint_sentence(turned)}
    assert told["hints"] == [{"kind": "turned_frame", "numbers": [0.02], "names": [], **said}]


@pytest.mark.parametrize(
    ("notice", "words"),
    [
        (Notice(NoticeKind.READ, said="columns not used: a"), "columns not used: a"),
        (Notice(NoticeKind.AS_FITTED, ("huber",), (3, 7)), "as in the model's fit: loss huber; 2 poses left out: 3, 7"),
        (
            Notice(NoticeKind.OTHER_DATA, ("", "drift@base")),
            "the file of these poses is not what the model was fitted to; ",
        ),
        (Notice(NoticeKind.OTHER_EFFECTS, ("own.py", "m.toml")), "own.py is not the file that m.toml was fitted with"),
        (Notice(NoticeKind.OTHER_PRIOR, ("printed",)), "the model was fitted with the prior 'printed'; the diagnosis"),
        (
            Notice(NoticeKind.DIMENSIONS_HELD, ("a", "b")),
            "2 offsets and compliances that the model's fit held",
        ),
        (Notice(NoticeKind.FIELD_LEFT_OUT), "the residual field is left out here: it is no cause; add it again when"),
        (Notice(NoticeKind.OUTLIERS, poses=(9,)), "outliers, left out: pose 9"),
    ],
)
def test_every_notice_is_printed_in_words(notice: Notice, words: str) -> None:
    assert str(notice).startswith(words)


SHOWN, MORE = ErrorStats(1.5e-3, 2.0e-3, 3e-3, 1e-3), ErrorStats(2.5e-3, 3.0e-3, 4e-3, 1e-3)


def test_the_error_from_the_daemons_record_leads_and_the_one_without_stands_below() -> None:
    """The first was left out where it is that in the session, and only the second was called *as deployed*."""
    state = StateAfterSession({"creep@joint2": "last"}, {}, memory={"creep@joint2": SessionMemory({}, (0.0,), (1.0,))})
    rows = deployed_rows(DeployedError(SHOWN, time_unknown=MORE, state=state), SHOWN)
    assert rows == [
        ("held out, as deployed on the arm", SHOWN),
        ("as deployed, no record of its moves", MORE),
    ]
    assert deployed_rows(DeployedError(SHOWN, time_unknown=MORE), SHOWN)[1][0] == "as deployed, power-on time unknown"


def test_an_error_as_deployed_that_is_that_in_the_session_is_not_repeated() -> None:
    assert deployed_rows(DeployedError(SHOWN, time_unknown=SHOWN), SHOWN) == []
    assert deployed_rows(DeployedError(MORE), SHOWN) == [("held out, as deployed on the arm", MORE)]


def test_auto_says_where_the_arm_gets_a_worse_model() -> None:
    """A memory was taken, and after a restart the arm was worse than before it: the output had the session's error."""
    state = StateAfterSession({"creep@joint2": "last"}, {}, memory={"creep@joint2": SessionMemory({}, (0.0,), (1.0,))})
    started, remembers = DeployedError(SHOWN), DeployedError(SHOWN, time_unknown=MORE, state=state)
    told = "3.00 mm RMS, before auto 2.00 mm, after a restart of the arm's daemon, which then does not know "
    assert error_raised_sentence(started, remembers) == f"{told}the earlier moves"
    assert error_raised_sentence(started, DeployedError(SHOWN, time_unknown=MORE)).endswith("time since power-on")
    assert error_raised_sentence(started, DeployedError(MORE)) == "3.00 mm RMS, before auto 2.00 mm, as deployed"
    assert not error_raised_sentence(DeployedError(MORE), DeployedError(SHOWN, time_unknown=MORE))
    assert not error_raised_sentence(started, DeployedError(MORE, fewer=113)), "of other poses"


@pytest.mark.parametrize(("effect", "said"), [("drift@joint2", True), ("measurement_frame@frame", False)])
def test_the_points_of_a_tracker_that_errs_do_not_tell_what_the_arm_gets(effect: str, said: bool) -> None:
    ends = [SimpleNamespace(held_out=SimpleNamespace(deployed=DeployedError(one))) for one in (SHOWN, MORE)]
    model = SimpleNamespace(effects=effects_at(load_arm("lrm-lab"), effect))
    course: Any = SimpleNamespace(steps=ends, model=model)
    assert [label for label, _ in error_raised_on_the_arm(course)] == ["on the arm"] * said


@pytest.mark.parametrize("above", [True, False])
def test_a_law_that_is_followed_is_doubted_where_more_than_the_noise_is_left(above: bool) -> None:
    """Of 18 such laws 11 were worse on the arm than their state alone; of 32 with nothing left three."""
    memory = {"creep@joint2": SessionMemory({}, (0.0,), (1.0,))}
    state = StateAfterSession({}, {}, {"drift@joint3": 0.0}, memory)
    course: Any = SimpleNamespace(model=SimpleNamespace(state=state), diagnosis=SimpleNamespace(above_floor=above))
    facts = [*laws_that_may_be_wrong(course)]
    assert [label for label, _ in facts] == ["law"] * above
    followed = "the arm's daemon follows warm-up drift of joint 3, creep of joint 2. "
    assert all(words.startswith(followed) for _, words in facts)


def test_a_scale_that_is_open_asks_for_a_known_length() -> None:
    assert scale_sentence(None) == ""
    for scale, begins in (
        (ScaleUncertainty(), "taken as right"),
        (ScaleUncertainty(2e-3, 1e-3), "known to ± 2 mm/m along"),
    ):
        assert scale_sentence(scale).startswith(begins)
        assert scale_sentence(scale).endswith("measure some distances, too (distance_mm), with a string or a ball bar.")


def test_the_names_in_a_claim_are_parameters_or_the_place() -> None:
    (effect,) = effects_at(load_arm("lrm-lab"), "backlash@joint2")
    assert effect.about.claimed - {"place"} <= {parameter.name for parameter in effect.parameters}
    assert "place" in effect.about.claimed


@pytest.mark.parametrize(
    ("mode", "kind", "asked"),
    [
        (CommonMode.YIELDING, "order", True),
        (CommonMode.YIELDING, "time", True),
        (CommonMode.YIELDING, "load", False),
        (CommonMode.GAIN, "order", False),
    ],
)
def test_joints_that_all_yield_otherwise_meanwhile_ask_for_the_load(mode: CommonMode, kind: Kind, asked: bool) -> None:
    """A gripper that was given a load half-way, without payload_g: nothing hinted at it."""
    function = FreeFunction(None, (ExplanatoryVariable(kind),), (), common=mode)
    assert ("payload_g" in what_may_change(function)) == asked
