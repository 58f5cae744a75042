"""The public API: its doctest, the notebook of the docs, the names that it promises, and what its arguments may be."""

from __future__ import annotations

import ast
import doctest
import inspect
import json
import re
import runpy
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pdoc import pdoc

import lrm_ident as lrm
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.distances import Distances
from lrm_ident.data.observations.encoder_readings import EncoderReadings
from lrm_ident.data.observations.observation import Observation
from lrm_ident.data.observations.orientations import Orientations
from lrm_ident.data.source import Source
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.loss import loss_named
from lrm_ident.fitting.parameter_sets import select_parameters
from lrm_ident.residual.error_breakdown import NestedResidual
from lrm_ident.study import api
from lrm_ident.study.arguments import options_in_python
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import FileError, LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.model import model_of
from lrm_math.model.reading import Reading
from tests.conftest import ROOT


@pytest.mark.slow
def test_the_doctest_of_the_api_holds() -> None:
    assert doctest.testmod(api, verbose=False) == doctest.TestResults(failed=0, attempted=4)


@pytest.mark.slow
def test_the_notebook_of_the_docs_names_the_hidden_effect(capsys: pytest.CaptureFixture[str]) -> None:
    cells = json.loads((ROOT / "docs" / "example.ipynb").read_text(encoding="utf-8"))["cells"]
    told: dict[str, Any] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "what a cell printed is not kept"
            exec("".join(cell["source"]), told)
    assert told["diagnosis"].first.scored.name == "backlash@joint2"
    assert told["second"].held_out.error.mean < 0.25 * told["first"].held_out.error.mean
    assert "backlash" in (told["folder"] / "model.toml").read_text()
    assert "nothing_missing" in capsys.readouterr().out
    shown = {name: told[name]._repr_html_() for name in ("study", "first", "diagnosis")}
    assert all("<table" in html for html in shown.values())
    assert "backlash@joint2" in shown["diagnosis"]
    assert "data:image/png" in shown["diagnosis"]
    assert "data:image/png" in shown["first"]
    assert "<iframe" in told["better"].view()._repr_html_()
    for result in (told["study"], told["first"], told["diagnosis"], told["diagnosis"].first):
        assert len(repr(result)) < 200, "a notebook asks for this beside the picture, and keeps it"


@pytest.mark.slow
def test_the_recipe_of_the_docs_finds_what_it_hides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs" / "your-arm.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.S)
    (tmp_path / "recipe.py").write_text(code, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    told = runpy.run_path("recipe.py")
    assert told["found"].first.scored.name == "backlash@joint2"
    better = told["study"].add("backlash@joint2").model
    assert better.value("backlash.joint2.b_rad") == pytest.approx(told["hidden"]["backlash.joint2.b_rad"], rel=0.1)
    (sentence,) = re.findall(r"\*(joint 2 has .*?)\*", page)
    assert sentence in capsys.readouterr().out


@pytest.mark.long
def test_objects_say_in_a_line_what_they_are(example_study: lrm.Study, better_study: lrm.Study) -> None:
    data, study, better = lrm.load(lrm.EXAMPLE), example_study, better_study
    begun, known = lrm.Study.of(data), len(study.model.free)
    columns = "positions, payloads, times, sessions"
    assert repr(data) == f"<Measurements of lrm-lab: 300 poses, 6 joints; {columns}; hidden-play.csv>"
    count = f"{len(begun.model.free)} free parameters, 300 poses"
    assert repr(begun) == f"<Study of lrm-lab: nothing is fitted yet; {count}>"
    assert repr(study) == f"<Study of lrm-lab: fit; {known} free parameters, 300 poses>"
    assert repr(better).startswith("<Study of lrm-lab: fit, add backlash@joint2; ")
    assert repr(replace(better, source=better.file, step=None)) == repr(better)
    assert re.fullmatch(rf"<Fit of lrm-lab: {known} parameters, 300 poses, \d+\.\d+ mm RMS>", repr(study.taken.fit))
    assert repr(data.poses) == "<Poses: 300 of 6 joints>"
    effects, total = "offsets, compliance, backlash@joint2", len(better.model.keys)
    assert repr(better.model) == f"<Model of lrm-lab: {effects}; {total} parameters, {len(better.model.free)} free>"
    assert re.fullmatch(r"<HeldOutResidual: \d+\.\d+ mm mean, \d+\.\d+ mm RMS>", repr(study.held_out))
    assert len(repr(study.errors)) < 600
    assert repr(NestedResidual(None, "too few")) == "<NestedResidual: too few>"
    assert repr(begun.model.arm) == "<Arm lrm-lab: 6 joints>"
    assert repr(load_arm("two-joint")) == "<Arm two-joint: 2 joints>"
    assert repr(load_arm("so101")).startswith("<Arm so101: 5 joints (shoulder_pan, shoulder_lift, ")


def test_a_signature_names_the_catalogue_and_does_not_list_it() -> None:
    assert " = CATALOGUE, " in str(inspect.signature(lrm.Study.of))


@pytest.mark.long
def test_a_notebook_shows_what_a_step_left_out_below_the_steps() -> None:
    study = replace(lrm.Study.of(lrm.load(lrm.EXAMPLE)).fit("option3"), notices=("outliers, left out: pose 7",))
    assert "<p>outliers, left out: pose 7</p>" in study._repr_html_()


@pytest.mark.long
@pytest.mark.parametrize(
    ("seen", "word"),
    [
        (Orientations(np.zeros((2, 3, 3))), "orientations"),
        (EncoderReadings(np.zeros((2, 6))), "joint feedback"),
        (Distances(np.ones(2)), "distances"),
    ],
)
def test_measurements_name_what_was_measured(seen: Observation, word: str) -> None:
    data = lrm.load(lrm.EXAMPLE).take([0, 1])
    assert word not in repr(data)
    assert word in repr(data.beside(seen))
    assert "standard deviations" in repr(data.with_positions(replace(data.positions, sd=np.ones(2))))


@pytest.mark.slow
def test_the_reference_shows_every_public_function(tmp_path: Path) -> None:
    pdoc("lrm_ident.study.api", "lrmd.client", output_directory=tmp_path)
    page = (tmp_path / "lrm_ident" / "study" / "api.html").read_text()
    assert all(f'id="{name}"' in page for name in api.__all__)
    assert 'id="Rover.move"' in (tmp_path / "lrmd" / "client.html").read_text()


def test_every_public_name_exists_and_says_what_it_is() -> None:
    assert lrm.__all__ == sorted([*api.__all__, "plot"], key=lambda name: (not name.isupper(), name))
    assert set(lrm.__all__) <= set(dir(lrm))
    for name in lrm.__all__:
        value = getattr(lrm, name)
        assert isinstance(value, Path) or inspect.getdoc(value)
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        _ = lrm.fitt  # type: ignore[attr-defined]


def test_what_cannot_be_plotted_or_fitted_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(LrmError, match="cannot plot a str"):
        lrm.plot("a model", tmp_path / "x.png")
    data = lrm.load(lrm.EXAMPLE)
    nameless = Measurements.of_tcp(data.poses, data.tcp, data.positions.noise_sd, pose=data.pose)
    with pytest.raises(LrmError, match="no arm"):
        lrm.fit(nameless)


def test_a_saved_model_finds_the_file_of_its_arm(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text((ROOT / "config" / "arms" / "lrm-lab.toml").read_text().replace('name = "lrm-lab"', 'name = "own"'))
    data = lrm.load(lrm.EXAMPLE, arm=str(own))
    lrm.save(lrm.fit(data, parameters="option3"), data, str(tmp_path / "model.toml"))
    assert lrm.load_model(str(tmp_path / "model.toml")).arm == data.source.arm


BELT = """
from lrm_math.effects import Description, JointEffect, LinearEffect, Parameter


class Belt(JointEffect, LinearEffect):
    id = "belt"
    about = Description("A belt stretches.", "δq = c q", "my arm")
    parameters = (Parameter("c_rad_per_rad", "turn per turn", 0.005),)

    def basis(self, poses, tau):
        return ((poses.angle(self.joint),),)
"""
SOME_JOINTS = "offsets.joint1.theta_rad,offsets.joint2.theta_rad"


@pytest.fixture(scope="module")
def data() -> Measurements:
    return lrm.load(lrm.EXAMPLE)


@pytest.fixture(scope="module")
def fitted(data: Measurements) -> Fit:
    return lrm.fit(data, parameters=SOME_JOINTS)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda wrong, _: lrm.load(wrong), "a dict stands where the path of a file should; .*to_csv"),
        (lambda wrong, _: lrm.load_poses(wrong, "so101"), "where the path of a file should"),
        (lambda wrong, _: lrm.read_study(wrong, "data.csv"), "where the path of a file should"),
        (lambda wrong, _: lrm.read_study("model.toml", wrong), "where the path of a file should"),
        (lambda wrong, _: lrm.fit(wrong), r"a dict stands where measurements should; lrm\.load"),
        (lambda wrong, _: lrm.Study.of(wrong), "where measurements should"),
        (lambda wrong, fit: lrm.diagnose(fit, wrong), "where measurements should"),
        (lambda wrong, fit: lrm.compare(wrong, fit), r"a dict stands where a model should; lrm\.fit\(data\)"),
        (lambda wrong, fit: lrm.predict(wrong, fit), "where a model should"),
        (lambda wrong, fit: lrm.predict(fit, wrong), r"a dict stands where poses should; data\.poses"),
        (lambda _, fit: lrm.predict(fit, np.zeros((2, 6))), "an ndarray stands where poses should"),
        (lambda _, fit: lrm.add(fit, lrm.load(lrm.EXAMPLE), ["backlash"]), "a list stands where the name of an effect"),
        (lambda wrong, _: lrm.load(lrm.EXAMPLE, wrong), "a dict stands where the name of an arm should; arm='so101'"),
        (lambda wrong, _: lrm.load_poses(lrm.EXAMPLE, wrong), "where the name of an arm should"),
        (lambda *_: lrm.load(lrm.EXAMPLE, reading="rad"), r"a str stands where a reading should; lrm\.Reading"),
        (lambda wrong, _: lrm.load(lrm.EXAMPLE, reading=wrong), "reading: q1_deg: "),
        (lambda wrong, fit: lrm.save(wrong, fit, "x.toml"), r"a dict stands where a fit should; lrm\.save\(fit, data"),
    ],
)
def test_a_wrong_kind_of_argument_is_one_line(call: Callable[[Any, Any], object], words: str, fitted: Fit) -> None:
    with pytest.raises(LrmError, match=words) as caught:
        call({"q1_deg": [0.0]}, fitted)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("step", [lrm.compare, lrm.diagnose, lambda fit, of: lrm.add(fit, of, "backlash@joint2")])
def test_a_model_of_another_arm_is_refused(step: Callable[[Any, Any], object], fitted: Fit, data: Measurements) -> None:
    with pytest.raises(LrmError, match="the model is of lrm-lab, the measurements of lrm-rover"):
        step(fitted, replace(data, source=Source(arm=load_arm("lrm-rover"))))


def test_poses_of_another_number_of_joints_are_refused(fitted: Fit) -> None:
    with pytest.raises(LrmError, match="the poses are of 5 joints, lrm-lab has 6"):
        lrm.predict(fitted, poses_of(np.zeros(5)))


def test_a_fit_predicts_as_its_model_does(fitted: Fit, data: Measurements) -> None:
    assert np.array_equal(lrm.predict(fitted, data.poses), lrm.predict(fitted.model, data.poses))


def test_names_by_commas_or_as_a_list_are_the_same(fitted: Fit, data: Measurements) -> None:
    other = lrm.fit(data, "offsets, compliance", SOME_JOINTS.split(","))
    assert other.model.keys == fitted.model.keys
    assert np.array_equal(other.model.values, fitted.model.values)


def test_a_loss_by_its_name_is_that_loss(data: Measurements) -> None:
    few, joints = data.take(np.arange(0, len(data), 3)), SOME_JOINTS.split(",")
    named, itself = (lrm.Study.of(few).fit(joints, loss) for loss in ("huber", loss_named("huber")))
    assert named.loss == itself.loss
    assert np.array_equal(named.model.values, itself.model.values)


def test_effects_of_ones_own_are_read_from_their_file(data: Measurements, tmp_path: Path) -> None:
    own = tmp_path / "belt.py"
    own.write_text(BELT, encoding="utf-8")
    for catalogue in (own, str(own), lrm.catalogue_with(own)):
        study = lrm.Study.of(data, "offsets, belt@joint2", catalogue)
        assert study.model.effects[-1].name == "belt@joint2"


def test_a_reading_may_be_a_mapping_of_its_fields(data: Measurements) -> None:
    read = lrm.load(lrm.EXAMPLE, reading={"angle_unit": "deg", "joint_sign": [1] * 6})  # type: ignore[arg-type]
    assert np.array_equal(read.poses.q, data.poses.q)
    assert read.source.reading.said() == {"angle_unit": "deg", "joint_sign": [1] * 6}


def test_a_set_of_the_thesis_is_of_six_joints() -> None:
    five = load_arm("so101")
    with pytest.raises(LrmError, match="option1 is of an arm of six joints; identifiable is of any"):
        select_parameters(model_of(five, effects_at(five, "compliance")), "option1")


def test_poses_are_read_by_the_name_of_their_arm(tmp_path: Path) -> None:
    table = tmp_path / "poses.csv"
    table.write_text("q1_deg,q2_deg\n10,20\n", encoding="utf-8")
    assert np.degrees(lrm.load_poses(table, "two-joint").q) == pytest.approx(np.array([[10.0, 20.0]]))


@pytest.mark.long
def test_an_unfitted_study_is_diagnosed_as_it_is_and_its_first_candidate_added(data: Measurements) -> None:
    study = lrm.Study.of(data.take(np.arange(0, len(data), 3)), "offsets")
    first = study.diagnose().first
    by_candidate, by_name = study.add(first), study.add(first.scored.name)
    assert by_candidate.taken.name == by_name.taken.name
    assert np.array_equal(by_candidate.model.values, by_name.model.values)


@pytest.mark.parametrize(
    ("message", "note"),
    [
        ("if so: --angle-unit rad (then …)", 'lrm.Reading(angle_unit="rad")'),
        ("if so: --axes=-x,-y,z and --unit m (then …)", 'lrm.Reading(axes="-x,-y,z", unit="m")'),
        ("--joint-sign 1,-1,1; or", "lrm.Reading(joint_sign=[1, -1, 1])"),
        ("leave 2 rows out with --bad-rows skip", 'lrm.Reading(bad_rows="skip")'),
    ],
)
def test_options_that_a_message_advises_are_noted_as_python_takes_them(message: str, note: str) -> None:
    @options_in_python
    def read() -> None:
        raise LrmError(message)

    with pytest.raises(LrmError) as caught:
        read()
    (line,) = caught.value.__notes__
    assert line == f"in Python: reading={note}"
    fields = {word.arg: ast.literal_eval(word.value) for word in ast.parse(note, mode="eval").body.keywords}  # type: ignore[attr-defined]
    assert Reading(**fields).said() == fields


def test_a_message_without_options_of_a_reading_has_no_note() -> None:
    with pytest.raises(FileError) as caught:
        lrm.load("nowhere.csv")
    assert not hasattr(caught.value, "__notes__")


@pytest.mark.long
def test_advice_that_is_followed_reads_the_file(tmp_path: Path, data: Measurements) -> None:
    header, *rows = lrm.EXAMPLE.read_text(encoding="utf-8").splitlines()
    columns = header.split(",")
    angles = [k for k, name in enumerate(columns) if name.startswith("q")]
    plain = [name.removesuffix("_deg") for name in columns]
    cells = [row.split(",") for row in rows]
    for row in cells:
        for k in angles:
            row[k] = f"{np.radians(float(row[k])):.9f}"
    table = tmp_path / "rad.csv"
    table.write_text("\n".join([",".join(plain), *map(",".join, cells)]), encoding="utf-8")
    with pytest.raises(FileError) as caught:
        lrm.load(table, arm="lrm-lab")
    reading = eval(caught.value.__notes__[0].partition("reading=")[2], {"lrm": lrm})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        read = lrm.load(table, arm="lrm-lab", reading=reading)
    assert read.poses.q == pytest.approx(data.poses.q, abs=1e-8)


def test_what_was_left_out_of_a_file_is_warned_of(tmp_path: Path) -> None:
    header, *rows = lrm.EXAMPLE.read_text(encoding="utf-8").splitlines()
    x = header.split(",").index("x_mm")
    cells = rows[4].split(",")
    cells[x : x + 3] = ["0", "0", "0"]
    table = tmp_path / "lost.csv"
    table.write_text("\n".join([header, *rows[:4], ",".join(cells), *rows[5:], ""]), encoding="utf-8")
    with pytest.warns(UserWarning, match="exactly 0, 0, 0") as told:
        data = lrm.load(table, arm="lrm-lab")
    assert len(data) == len(rows) - 1
    assert told[0].filename == __file__
