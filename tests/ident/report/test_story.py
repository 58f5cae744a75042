"""The story of a model: the same course of the error at every door, and never the last, smallest step alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lrm_ident.diagnosis.attribution import StepAttribution, term_of
from lrm_ident.diagnosis.evidence import Evidence
from lrm_ident.diagnosis.judgement import Support
from lrm_ident.report.diagnosis.course import attribution_blocks
from lrm_ident.report.document import Facts
from lrm_ident.report.plain_names import plain_name
from lrm_ident.report.plots.interactive.values import waterfall_values
from lrm_ident.report.plots.story import draw_story
from lrm_ident.report.story import GEOMETRY, Story, story_of_file
from lrm_ident.residual.error_breakdown import NestedResidual
from lrm_ident.study.course_table import with_course
from lrm_ident.study.model_history import model_text, undo_step
from lrm_math.model.model_file import CourseTable, HistoryTable, ModelFile
from lrm_math.toml_file import read_toml

COURSE = CourseTable(
    shows={"cable_curve@joint1+joint2": "empirical term", "backlash@joint2": "identified cause"},
    noise_rms_mm=0.5,
    nested_rms_mm=2.1,
    nested_deployed_rms_mm=2.3,
)


def step(name: str, fitted: float, held: float | None, **more: object) -> HistoryTable:
    """An entry of a history."""
    known = {"step": name, "fit_rms_mm": fitted, "held_out_rms_mm": held, "effects": ["offsets"], "parameters": {}}
    return HistoryTable.model_validate({**known, "deployed_rms_mm": held, **more})


def file_of(*history: HistoryTable) -> ModelFile:
    """A model file of a history."""
    return ModelFile(schema="lrm/model/1", arm="lrm-lab", effects=["offsets"], history=list(history))


@pytest.fixture
def file() -> ModelFile:
    """Nominal 30, then 4.8, then two effects."""
    return file_of(
        step("fit", 4.6, 4.8, nominal_rms_mm=30.0),
        step("add cable_curve@joint1+joint2", 2.4, 2.6),
        step("add backlash@joint2", 1.7, 1.9, course=COURSE),
    )


def told(file: ModelFile) -> Story:
    """The story of a file that has one."""
    story = story_of_file(file)
    assert story is not None
    return story


def test_the_course_begins_with_the_nominal_arm_and_says_what_each_step_is(file: ModelFile) -> None:
    story = told(file)
    fall = (
        "nominal 30.0 → lengths, angles and stiffness fitted 4.80 → with 1 empirical term and 1 identified cause: "
        "1.90 mm RMS at poses not in the fit"
    )
    assert story.sentence.replace("30.00", "30.0") == fall
    assert [one.title for one in story.steps[:2]] == ["nominal", GEOMETRY]
    assert [(one.before_rms_mm, one.rms_mm) for one in story.steps[1:]] == [(30.0, 4.8), (4.8, 2.6), (2.6, 1.9)]
    assert dict(story.facts).keys() == {"nested", "measurement noise"}, "as deployed it is the same, and said once"
    assert dict(
        told(file_of(*file.history[:2], step("add mass@link5", 1.7, 1.9, deployed_rms_mm=2.2))).facts
    ).keys() == {"as deployed"}
    assert story.as_json()["nested_rms_mm"] == 2.1
    assert [one.title for one in story.ends] == ["nested, effects chosen anew"]
    assert story.noise is not None
    assert (story.noise.title, story.noise.rms_mm) == ("measurement noise", 0.5)
    assert 2 * 4.8 > story.longest > 4.8, "the bar of the nominal arm is cut short"


def test_the_file_keeps_it_and_undo_forgets_what_is_no_longer_so(file: ModelFile, tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(model_text(file), encoding="utf-8")
    assert read_toml(path, ModelFile) == file
    before = told(undo_step(file))
    assert [one.kind for one in before.steps] == ["nominal", "fit", "effect"]
    assert before.nested_rms_mm is None


def test_errors_of_the_fit_where_some_are_not_held_out(file: ModelFile) -> None:
    first, *rest = file.history
    story = told(file_of(first, *rest, step("add mass@link5", 1.5, None)))
    assert not story.held_out
    assert [one.rms_mm for one in story.steps[1:]] == [4.6, 2.4, 1.7, 1.5]
    assert story_of_file(file_of(step("fit", 4.6, 4.8))) is None, "an older file does not know the nominal arm's error"


def test_the_page_prints_every_error_of_a_story_as_the_terminal_does(file: ModelFile) -> None:
    """Errors of hundredths of a millimetre have more decimals."""
    story = replace(told(file), noise_rms_mm=0.0703, nested_rms_mm=0.0712)
    shown, printed = waterfall_values(story), dict(story.facts)
    assert shown["noise"]["left"] == "0.070"
    for row in (*shown["ends"], shown["noise"]):
        assert printed[row["title"].partition(",")[0]].startswith(f"{row['left']} mm RMS")


@pytest.mark.long
def test_the_waterfall_is_a_figure_with_a_bar_for_each_step(file: ModelFile, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    figure = draw_story(told(file), tmp_path / "story.png")
    assert (tmp_path / "story.png").is_file()
    (axes,) = figure.axes
    labels = [label.get_text().replace("\n", " ") for label in axes.get_yticklabels()]
    assert labels[:2] == ["nominal", GEOMETRY]
    assert labels[-1] == "nested, effects chosen anew"
    assert "as deployed" not in labels, "where it is the same, it is said once"
    assert "identified cause" in labels[3]


@pytest.mark.long
@pytest.mark.parametrize("deployed", [12.0, 92.0])
def test_every_bar_of_the_waterfall_ends_inside_it(deployed: float) -> None:
    """An arm that errs more as deployed than its steps did, and a nominal arm that errs far more."""
    pytest.importorskip("matplotlib")
    last = step("add backlash@joint2", 2.2, 2.5, deployed_rms_mm=deployed)
    (axes,) = draw_story(told(file_of(step("fit", 6.1, 6.5, nominal_rms_mm=420.0), last))).axes
    assert max(bar.get_x() + bar.get_width() for bar in axes.patches) < axes.get_xlim()[1]


@pytest.mark.parametrize("misspecified", [(), ("servo_gain@joint1",)])
@pytest.mark.parametrize("noise", [None, 0.1])
def test_auto_says_which_candidates_act_otherwise(misspecified: tuple[str, ...], noise: float | None) -> None:
    steps = [None, SimpleNamespace(added="servo_gain@joint1", evidence=Evidence())]
    attributions, known = (
        [StepAttribution(Support.POSSIBLE_CAUSE, 0.05)],
        SimpleNamespace(floor=SimpleNamespace(rms=noise)),
    )
    report = SimpleNamespace(misspecified=misspecified, diagnosis=known)
    course: Any = SimpleNamespace(steps=steps, attributions=attributions, explained=[1.0], report=report)
    title, facts = attribution_blocks(course)
    assert str(title).startswith("No cause is certain.")
    assert isinstance(facts, Facts)
    ((label, words),) = facts.rows
    assert label == "candidate cause"
    assert words.startswith("servo gain error of joint 1 (servo_gain@joint1): ")
    assert ("also moves the arm elsewhere" in words) == bool(misspecified)
    assert ("times the squared error that it explains" in words) != bool(misspecified)
    assert ("as the noise is not known" in words) == (noise is None and not misspecified)


def test_the_error_as_deployed_comes_with_its_interval(file: ModelFile) -> None:
    known = step("add mass@link5", 1.7, 1.9, deployed_rms_mm=2.2, deployed_95_mm=[2.0, 2.42])
    story = told(file_of(*file.history[:2], known))
    assert dict(story.facts)["as deployed"].startswith("2.20 mm RMS (2.00 to 2.42, 95 %)")


def test_one_of_a_class_is_no_identified_cause_at_any_door() -> None:
    """Else the card says *identified* where the verdict says that these poses cannot distinguish it."""
    one, other = "servo_gain@joint1", "cable_spring@joint1"
    course: Any = SimpleNamespace(
        steps=[None, SimpleNamespace(added=one, evidence=Evidence((other,)))],
        attributions=[StepAttribution("finding", 0.0)],
        explained=[1.0],
        report=SimpleNamespace(misspecified=(), diagnosis=SimpleNamespace(floor=SimpleNamespace(rms=None))),
    )
    words = " ".join(map(str, attribution_blocks(course)))
    assert f"Indistinguishable with these poses: {plain_name(one)} ({one}), or {plain_name(other)}" in words
    assert "Identified" not in words
    fitted = file_of(step("fit", 4.6, 4.8, nominal_rms_mm=30.0), step(f"add {one}", 1.7, 1.9))
    story = told(with_course(fitted, course, NestedResidual(None)))
    assert story.sentence.endswith("with 1 indistinguishable cause: 1.90 mm RMS at poses not in the fit")
    assert term_of("finding", ()) == "identified cause"
    assert term_of("description", (other,)) == "empirical term"
