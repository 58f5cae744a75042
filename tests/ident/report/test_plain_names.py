"""Plain names: what has a code name gets its words where it is a value, and no sentence is parsed for names."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lrm_ident.report.plain_names import plain_name
from lrm_ident.report.text.variables import in_a_sentence
from lrm_ident.residual.covariates import ExplanatoryVariable
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import ALL_EFFECTS, CATALOGUE
from lrm_math.effects.base import Excitation
from lrm_math.effects.curves import CouplingCurve
from lrm_math.effects.servo_errors import Coupling
from lrm_math.kinematics.poses import poses_of
from tests.conftest import ROOT

CODE_NAME = re.compile(r"\w@\w|\b(?:joint|link|mimic|q|tau)\d+\b")
"""An effect, a place, or the symbol of a quantity of one joint; no column, as `q1_meas_deg`."""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("backlash@joint2", "backlash in joint 2"),
        ("coupling@joint3<-joint2", "coupling of joint 3 by joint 2"),
        ("cable_curve@joint1+joint2", "a smooth curve over joints 1 and 2"),
    ],
)
def test_names_of_effects_have_words(name: str, words: str) -> None:
    assert plain_name(name) == words


@pytest.mark.parametrize(
    ("variable", "symbol", "words"),
    [
        (ExplanatoryVariable("angle", 0), "q1", "the angle of joint 1"),
        (ExplanatoryVariable("torque", 13, before=True), "tau14 before", "the torque of joint 14 before"),
        (ExplanatoryVariable("motion", 2), "the last motion of q3", "the last motion of the angle of joint 3"),
        (ExplanatoryVariable("order"), "order", "the order of measurement"),
        (ExplanatoryVariable("x"), "position x", "x of the tip"),
    ],
)
def test_variables_have_a_symbol_and_words(variable: ExplanatoryVariable, symbol: str, words: str) -> None:
    assert variable.symbol == symbol
    assert in_a_sentence(variable) == words


@pytest.mark.parametrize("kind", ALL_EFFECTS, ids=lambda kind: kind.id)
def test_what_an_effect_says_holds_no_code_name(kind: type) -> None:
    """Its claim, and what poses lack to show it: an arm that stands still lacks everything."""
    arm = load_arm("lrm-lab")
    still = Excitation(poses_of(np.zeros((3, arm.dof))), np.zeros((3, arm.dof)))
    for effect in (kind(arm, place) for place in kind.places(arm)):
        numbers = {parameter.name: "0" for parameter in effect.parameters}
        claim = effect.about.claimed_with(effect.place_in_words, numbers)
        assert not CODE_NAME.search(claim), claim
        assert not CODE_NAME.search(effect.missing_excitation(still) or "")


@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.id)
def test_no_claim_holds_a_minus_sign(kind: type) -> None:
    """Before: *the tracker stretches by -8 mm/m*, and the same in the title of a card."""
    arm = load_arm("lrm-lab")
    for effect in (kind(arm, place) for place in kind.places(arm)):
        signed = {p.name: "5 mm" if p.lower >= 0.0 or p.name == "last_pose" else "-5 mm" for p in effect.parameters}
        assert "-" not in effect.about.claimed_with(effect.place_in_words, signed)
        assert all("-" not in effect.about.sized(name, words) for name, words in signed.items())


def test_the_size_of_an_estimate_says_which_way() -> None:
    [tracker] = (kind.about for kind in CATALOGUE if kind.id == "depth_scale")
    assert tracker.sized("scale_mm_per_m", "-8.06 mm/m") == "8.06 mm/m too short"


def test_what_couples_two_joints_says_which_follows() -> None:
    arm = load_arm("lrm-lab")
    for kind in (Coupling, CouplingCurve):
        assert kind.about.claim.startswith("{place} by ")
        assert kind(arm, "joint3<-joint2").place_in_words == "joint 3 follows joint 2"


def test_judgements_are_not_parsed() -> None:
    """These rooms take no text apart; what people type and what formats need is named here."""
    typed_or_written = {"glossary.py", "comparison_scene.py"}
    sources = [
        path
        for room in ("fitting", "residual", "diagnosis", "report")
        for path in (ROOT / "lrm_ident" / room).rglob("*.py")
    ]
    assert len(sources) > 50
    parsing = {path.name for path in sources if "\nimport re\n" in path.read_text(encoding="utf-8")}
    assert parsing == typed_or_written
