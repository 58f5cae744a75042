"""Conclusions of diagnoses: the same first lines at every door, with a next command that runs."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.diagnosis.judgement import Support, Verdict
from lrm_ident.diagnosis.reason import Reason, ReasonKind
from lrm_ident.report.diagnosis.conclusion import conclude
from lrm_ident.report.diagnosis.diagnosis import diagnosis_document
from lrm_ident.report.diagnosis.pose_facts import valid_where
from lrm_ident.report.document import blocks_html
from lrm_ident.report.model_report import quick_report, with_diagnosis
from lrm_ident.report.plots.interactive.values import figure_values
from lrm_ident.report.text.next_steps import CommandNames, labelled
from lrm_ident.report.text.verdicts import HEADLINES
from lrm_ident.residual.data_audit import Limitation, LimitationKind
from lrm_ident.study.study import Study
from lrm_math.model.equilibrium import solve_equilibrium
from tests.conftest import EXAMPLE, ROOT
from tests.support.commands import stdout_of
from tests.support.misreadings import random_arm_data

pytestmark = pytest.mark.long

DEPLOYED = [
    ("", "lrm deploy MODEL"),
    ("", "lrm-ident verify --tracker dtrack:5000 --goals 50"),
    ("or repair, though the model corrects it",),
    ("for a URDF", "lrm-ident arm export MODEL -o arm.urdf"),
]
"""Leads and commands where nothing is missing and the model corrects what it has."""


@pytest.mark.parametrize("verdict", HEADLINES)
def test_the_docs_quote_every_headline(verdict: Verdict) -> None:
    assert f"| {HEADLINES[verdict]} (`{verdict}`)" in (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")


def test_an_identified_cause_is_named_with_its_figures(example_diagnosis: DiagnosisReport) -> None:
    found = conclude(example_diagnosis)
    facts = dict(found.facts)
    assert found.headline == "Missing from the model: backlash in joint 2 (backlash@joint2)"
    assert facts["certainty"].startswith("identified: other causes leave ≈ 1.4")
    steps = [(label, step.words.split()[0], len(step.commands)) for label, step in labelled(found.next)]
    assert steps == [("1.", "Add", 2), ("or:", "Add", 1), ("or repair, though the model corrects it:", "Preload", 0)]
    assert "3.03 → 0.57 mm RMS" in facts["held-out error"]
    assert facts["estimate"].endswith("of backlash, end to end")
    assert "as deployed" not in facts, "the arm gets the same error"
    assert not found.reasons


def test_a_page_says_that_its_diagnosis_has_another_prior(
    example_study: Study, example_diagnosis: DiagnosisReport
) -> None:
    """Its parameters and comparison are of the file's own fit, its diagnosis is not."""
    page = with_diagnosis(quick_report(example_study), example_diagnosis)
    assert "prior" not in dict(page.facts)
    assert page.file.provenance is not None
    stated = page.file.model_copy(update={"provenance": page.file.provenance.model_copy(update={"prior": "printed"})})
    assert "fitted with the prior 'printed'; the diagnosis" in dict(replace(page, file=stated).facts)["prior"]


def test_without_a_missing_effect_the_noise_is_the_reason(better_study: Study) -> None:
    report = better_study.diagnose()
    found = conclude(report)
    assert found.headline == "Corrected: backlash in joint 2; no further systematic error is seen."
    assert found.next[0].words == "Give the arm's daemon the model (nothing moves)", "stands at the command"
    assert dict(found.facts)["held-out error"].endswith("(1.1 times the measurement noise 0.52 mm)")
    assert [(step.lead, *step.commands) for step in found.next] == DEPLOYED
    assert "then measure and fit again" in found.next[2].words


def test_the_file_to_deploy_predicts_as_its_diagnosis_does(better_study: Study) -> None:
    """A diagnosis judges a fit without outliers, which a file that was fitted with them does not have."""
    data = better_study.data
    tcp = data.tcp.copy()
    tcp[[7, 40]] += [0.06, -0.05, 0.04]
    spoilt = replace(better_study, data=data.with_tcp(tcp)).fit()
    report = spoilt.diagnose()
    first, *_ = (step for step in conclude(report, CommandNames("m.toml", "d.csv")).next if "lrm deploy" in str(step))
    assert report.diagnosis.outliers == tuple(data.pose[[7, 40]].tolist())
    assert first.commands == ("lrm-ident auto m.toml d.csv -o best.toml", "lrm deploy best.toml")
    judged = report.diagnosis.fit.equilibrium
    run, after = spoilt.auto()
    best = solve_equilibrium(after.model, judged.poses)
    assert len(run.steps) == 1
    np.testing.assert_allclose(best.tcp, judged.tcp, rtol=0.0, atol=1e-8)
    assert after.diagnose().moved < 1e-6 < 1e-4 < report.moved


def test_an_arm_that_goes_on_changing_is_not_called_complete(better_study: Study) -> None:
    report = better_study.diagnose()
    among, later = report.deployed.now, replace(report.deployed.now, rms=2.5e-3)
    found = conclude(replace(report, deployed=replace(report.deployed, now=later, among_measured=among)))
    assert found.headline == (
        "Corrected: backlash in joint 2, but the arm goes on changing: earlier poses predict the later ones worse."
    )
    assert dict(found.facts)["as deployed"].startswith("2.50 mm RMS at later poses (0.57 mm among the measured poses)")


def test_for_machines_the_audit_has_values(example_diagnosis: DiagnosisReport) -> None:
    told = json.loads(diagnosis_document(example_diagnosis).json())
    assert [one["kind"] for one in told["audit"]] == [one.kind for one in example_diagnosis.limitations]
    assert [one["joint"] for one in told["holds"]] == [one.joint for one in valid_where(example_diagnosis)]
    assert all(one["least"] < one["most"] for one in told["holds"])


def test_what_no_pose_shows_is_stated(better_study: Study) -> None:
    """A wrong metre of the tracker looks like longer links; a known length decides."""
    words = dict(conclude(better_study.diagnose()).facts)["not tested"]
    assert words.startswith("the tracker's scale (1 mm/m costs 0.")
    assert "distance_mm" in words


def test_one_of_several_causes_is_not_called_the_one(better_study: Study) -> None:
    """Nor is it advised to replace the gear where a cable may be the cause."""
    name = "backlash@joint2"
    found = conclude(replace(better_study.diagnose(), indistinguishable={name: ("cable_spring@joint2",)}))
    assert found.headline == (
        "Corrected: backlash in joint 2, or another cause that these poses cannot distinguish from it; "
        "no further systematic error is seen."
    )
    facts = dict(found.facts)
    assert "backlash in joint 2, or cable pull on joint 2" in facts["certainty"]
    assert "gear of joint 2" in found.next[-2].words
    assert "cables at joint 2" in found.next[-2].words, "what to do in either case"


@pytest.mark.parametrize("rival", ["sway@joint2", "eccentricity@joint9", "offsets", "drift@joint2"])
def test_a_rival_that_poses_cannot_tell_of_stops_no_verdict(better_study: Study, rival: str) -> None:
    """An effect of one's own, a place that there is not, one that the model has, one that follows time alone."""
    found = conclude(replace(better_study.diagnose(), indistinguishable={"backlash@joint2": (rival,)}))
    assert [step.commands for step in found.next if step.commands and not step.lead] == [
        tuple(commands) for lead, *commands in DEPLOYED if commands and not lead
    ]


def test_a_rival_that_was_added_since_is_none(better_study: Study) -> None:
    report = better_study.diagnose()
    spring = next(effect.name for effect in report.diagnosis.fit.model.effects if effect.id == "compliance")
    found = conclude(replace(report, indistinguishable={"backlash@joint2": (spring,)}))
    assert found.headline.startswith("Corrected: backlash in joint 2")


def test_beside_a_cause_of_the_model_nothing_is_said_of_that_one(better_study: Study) -> None:
    """Before: *Identified cause: backlash* was followed by *No cause identified*."""
    left = replace(better_study.diagnose(), verdict=Verdict.UNPREDICTABLE)
    assert conclude(left).headline.startswith("No cause identified for the remaining error: ")


@pytest.mark.parametrize(
    ("joint", "timed", "said"),
    [(2, False, "order"), (1, False, ""), (2, True, "")],
    ids=["its joint", "other", "timed"],
)
def test_an_order_that_follows_the_joint_of_the_cause_is_said(
    example_diagnosis: DiagnosisReport, joint: int, timed: bool, said: str
) -> None:
    """A table sorted by a joint: what its order means is not known, unless it has times."""
    found = example_diagnosis.diagnosis
    poses = found.data.poses if timed else replace(found.data.poses, t=None)
    limitations = (Limitation(LimitationKind.ORDER, (joint,), (0.99,)),)
    data = replace(found.data, poses=poses)
    report = replace(
        example_diagnosis,
        limitations=limitations,
        diagnosis=replace(found, screening=replace(found.screening, data=data)),
    )
    words = dict(conclude(report).facts).get("order", "")
    assert words.startswith(f"the rows follow joint {joint} (correlation 0.99)" if said else "")
    assert bool(words) == bool(said)


def test_outliers_that_were_left_out_are_said_on_the_terminal(example_diagnosis: DiagnosisReport) -> None:
    spoiled = replace(example_diagnosis, diagnosis=replace(example_diagnosis.diagnosis, outliers=(7, 12)))
    count = len(spoiled.diagnosis.data) + 2
    said = dict(conclude(spoiled).facts)["left out"]
    assert said.startswith(f"2 of {count} poses, as outliers: 7, 12. Measured wrongly, or the arm did not get there")
    assert "7, 12. Measured" in diagnosis_document(spoiled).text()


def test_how_far_off_outliers_are_is_said(example_study: Study) -> None:
    """Before: numbers alone, beside an error at the noise: of an arm that missed 6 of 100 poses by up to 190 mm."""
    data = example_study.data
    moved = data.tcp.copy()
    moved[[6, 11]] += 0.05
    found = conclude(lrm.Study.of(data.with_tcp(moved)).fit().diagnose())
    assert f"2 of {len(data)} poses, as outliers, up to 8" in dict(found.facts)["left out"]


def test_auto_says_where_its_verdict_holds(tmp_path: Path) -> None:
    """Before: of 60 poses within 15 deg a model was offered without a word that it holds there alone."""
    data = random_arm_data("two-joint", 3, 60, 15.0)
    csv, model = tmp_path / "near.csv", tmp_path / "model.toml"
    csv.write_text(measurements_csv(data), encoding="utf-8")
    stdout_of("fit", csv, "--arm", "two-joint", "-o", model)
    said = stdout_of("auto", model, csv, "--no-nested", "-o", tmp_path / "best.toml")
    assert "only where it was measured: joint 1 from" in said


def test_a_known_effect_that_does_not_last_is_what_an_unexplained_error_acts_most_like(
    example_diagnosis: DiagnosisReport,
) -> None:
    """Before: a free function of two quantities, where the drift by the measured temperature explained more."""
    plain = next(one for one in example_diagnosis.ranking if one.name == "drift@joint2")
    why = Reason(ReasonKind.REFUSED, (1e-3,), because=Reason(ReasonKind.NOT_BETTER_LATER, (2e-3, 2.1e-3)))
    refused = replace(plain, held_out_rms=0.5e-3, verdict=Support.NO_EVIDENCE, fit=None, reason=why)
    report = replace(example_diagnosis, verdict=Verdict.UNEXPLAINED_STRUCTURE, ranking=(refused,))
    said = dict(conclude(report).facts)["acts most like"]
    assert said.startswith("warm-up drift of joint 2 (drift@joint2), which leaves ≈ 0.50 mm here. Not named, since")
    behind = replace(refused, reason=replace(why, because=Reason(ReasonKind.CHANCE)))
    assert "drift" not in dict(conclude(replace(report, ranking=(behind,))).facts).get("acts most like", "")


def test_a_study_knows_what_could_not_be_distinguished_also_from_its_file(better_study: Study, tmp_path: Path) -> None:
    assert better_study.step is not None
    evidence = replace(better_study.step.evidence, equivalent=("cable_spring@joint2",))
    study = replace(better_study, step=replace(better_study.step, evidence=evidence))
    study.save(tmp_path / "better.toml")
    opened = lrm.read_study(tmp_path / "better.toml", EXAMPLE)
    for one in (study, opened):
        assert one._indistinguishable["backlash@joint2"] == ("cable_spring@joint2",)


def test_what_cannot_be_distinguished_is_no_cause(real: Measurements) -> None:
    """The real arm: a spline over two joints, which three angles a joint do not resolve."""
    found = conclude(lrm.Study.of(real).fit().diagnose(), CommandNames("model.toml", "DATA.csv", "lrm-lab"))
    assert found.headline == HEADLINES[Verdict.EFFECT_DESCRIBES]
    assert "certainty" not in dict(found.facts)
    assert any(reason.startswith("few angles") for reason in found.reasons)
    measure, adding, repair = found.next
    design, add = (shlex.split(step.commands[0]) for step in (measure, adding))
    assert design[:3] == ["lrm-ident", "design", "lrm-lab"]
    assert add[:5] == ["lrm-ident", "add", "model.toml", "DATA.csv", "cable_curve@joint1+joint2"]
    assert measure.commands[1:] == (
        "lrm-ident fit DATA.csv --arm lrm-lab -o new.toml",
        "lrm-ident diagnose new.toml DATA.csv",
    )
    assert (repair.lead, repair.words) == ("to repair", "Nothing yet, since the cause is not certain")


def test_every_verdict_has_a_headline_and_a_next_step(better_study: Study) -> None:
    assert {*HEADLINES, "effect_missing"} == {*Verdict}
    report = better_study.diagnose()
    for verdict in HEADLINES:
        steps = list(labelled(conclude(replace(report, verdict=verdict)).next))
        assert steps[0][0] == "1."
        assert any("diagnose again" in step.words for _, step in steps) <= any(
            " diagnose " in command for _, step in steps for command in step.commands
        ), "which command that is"


@pytest.mark.parametrize(
    ("name", "others", "first", "why"),
    [
        (
            "depth_scale@frame",
            ("measurement_frame@frame",),
            "Find out which it is, since every measured position rests on it: tracker",
            "",
        ),
        ("change_point@joint3", (), "Find what moved or was pushed at joint 3", "it may change again"),
    ],
)
def test_what_the_model_does_not_correct_comes_before_the_model_is_deployed(
    example_study: Study, name: str, others: tuple[str, ...], first: str, why: str
) -> None:
    """Before: *repair* stood among the facts, *deploy* under Next, and readers did not know which comes first."""
    report = example_study.add(name).diagnose()
    quiet = replace(report, verdict=Verdict.NOTHING_MISSING, ranking=(), indistinguishable={name: others})
    (label, repair), (_, deploy), *_ = labelled(conclude(quiet).next)
    assert label == "1."
    assert repair.words.startswith(first)
    assert why in repair.words
    assert deploy.commands == ("lrm deploy MODEL",)


def test_terminal_page_and_json_list_the_same_steps(example_study: Study, example_diagnosis: DiagnosisReport) -> None:
    names = CommandNames("model.toml", "my data.csv", "lrm-lab")
    page = with_diagnosis(quick_report(example_study), example_diagnosis, names)
    assert page.diagnosis is not None
    listed = json.loads(page.diagnosis.json())["conclusion"]["next"]
    drawn, printed = figure_values(page)["next"], page.diagnosis.text(width=400)
    assert [(one["label"], one["commands"]) for one in listed] == [(label, said) for label, _, said in drawn]
    for label, sentence, commands in drawn:
        assert f"  {label} {sentence}" in printed
        assert all(f"{command}\n" in printed for command in commands)
    assert "lrm-ident diagnose better.toml 'my data.csv'" in drawn[0][2]


def test_each_jargon_word_is_explained_once_and_the_bars_have_a_scale(example_diagnosis: DiagnosisReport) -> None:
    document = diagnosis_document(example_diagnosis)
    for in_full in (False, True):
        said = [str(block) for block in document.printed(in_full)]
        assert sum("±: standard error" in words for words in said) == 1
        assert not any("root mean square" in words for words in said), "the line has room for two words"
    assert "0 to 3.03 mm" in document.text()


def test_a_fit_compares_its_error_with_the_noise_of_the_measurement(tmp_path: Path) -> None:
    said = " ".join(stdout_of("fit", EXAMPLE, "-o", tmp_path / "model.toml").split())
    assert "poses not in the fit it is 3.03 mm. 3.03 mm is 5.8 times the stated noise (0.52 mm)" in said
    assert "as deployed" not in said, "the arm gets the same error"


def test_terminal_and_page_show_the_same_lines(example_diagnosis: DiagnosisReport) -> None:
    document = diagnosis_document(example_diagnosis)
    html = blocks_html(document.whole)
    concluded = document.values["conclusion"]
    assert concluded.headline in html  # type: ignore[attr-defined]
    assert document.json().count('"headline"') == 1
    assert len(document.printed(in_full=False)) < len(document.printed(in_full=True))


def test_of_a_tracker_that_errs_the_deployed_error_is_said_to_have_its_own(
    example_study: Study, example_diagnosis: DiagnosisReport
) -> None:
    found = dict(conclude(example_study.add("measurement_frame@frame").diagnose()).facts)
    assert "as this tracker measures it" in found["as deployed"]
    assert "as deployed" not in dict(conclude(example_diagnosis).facts)
