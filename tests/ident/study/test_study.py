"""One spine: commands, API and study give the same files, and every later step uses loss and poses of the fit."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.report.text.notices import notice_words
from lrm_ident.study.inputs import arm_from
from lrm_ident.study.notices import NoticeKind
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.model_file import ProvenanceTable
from lrm_math.model.step_name import ADD, StepName
from tests.conftest import ROOT
from tests.support.commands import run_command, stdout_of
from tests.support.misreadings import random_arm_data
from tests.support.source_files import files, imported_names

pytestmark = [pytest.mark.usefixtures("one_step_folds"), pytest.mark.long]


LEFT_OUT, WRONG = [7, 20, 21], 33
OWN_EFFECT = '''
from lrm_math.effects.backlash import Backlash

class MyPlay(Backlash):
    """Play under another name."""

    id = "my_play"
'''
ONLY_A_STUDY = {
    "lrm_ident.diagnosis.add_effect": "add_effects",
    "lrm_ident.diagnosis.auto": "run_auto",
    "lrm_ident.diagnosis.diagnose": "diagnose",
    "lrm_ident.diagnosis.diagnosis_report": "build_report",
    "lrm_ident.diagnosis.symbolic_regression.proposal": "propose_law",
    "lrm_ident.diagnosis.nested_cross_validation": "nested_held_out",
    "lrm_ident.fitting.model_fit": "fit_model",
    "lrm_ident.residual.error_breakdown": "compare",
}
"""Functions that a step of an identification is made of."""
DOORS = ("lrm_ident/cli", "lrm_ident/workbench", "lrm_ident/fleet", "lrm_ident/measuring/campaign", "lrm_ident/design")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Measurements of an arm of one's own whose joint 1 turns too far, with four wrong positions, three of them
    left out by hand."""
    folder, arm = tmp_path_factory.mktemp("study"), load_arm("two-joint")
    data = random_arm_data("two-joint", 5, poses=60)
    turned = model_of(arm, effects_at(arm, "servo_gain@joint1"), {"servo_gain.joint1.g_plus_rad_per_rad": 0.05})
    data.tcp[:] += solve_equilibrium(turned, data.poses).tcp - solve_equilibrium(model_of(arm, ()), data.poses).tcp
    for number in (*LEFT_OUT, WRONG):
        data.tcp[data.pose == number] += [0.03, -0.03, 0.03]
    (folder / "data.csv").write_text(measurements_csv(data))
    (folder / "mine.py").write_text(OWN_EFFECT)
    (folder / "own.toml").write_text((ROOT / "config" / "arms" / "two-joint.toml").read_text())
    return folder


def content(path: Path) -> str:
    """The text of a model file but for the dates of its steps."""
    return re.sub(r"^date = .*$", "", path.read_text(encoding="utf-8"), flags=re.M)


def begun(folder: Path) -> lrm.Study:
    """A study of the measurements with an effect of one's own in its catalogue."""
    data = lrm.load(folder / "data.csv", arm=str(folder / "own.toml"))
    return lrm.Study.of(data.without(LEFT_OUT), catalogue=lrm.catalogue_with(folder / "mine.py"))


@pytest.mark.slow
def test_python_and_the_commands_write_the_same_files(folder: Path) -> None:
    csv, mine = folder / "data.csv", folder / "mine.py"
    told = {name: folder / f"{name}.toml" for name in ("fit", "add", "prior")}
    how = ["--arm", folder / "own.toml", "--leave-out", "7,20-21"]
    stdout_of("fit", csv, *how, "-o", told["fit"])
    stdout_of("add", told["fit"], csv, "my_play@joint2", "--effects-file", mine, "-o", told["add"])
    stdout_of("fit", csv, *how, "--prior", "printed", "-o", told["prior"])
    studies = {"fit": begun(folder).fit()}
    studies["add"] = studies["fit"].add("my_play@joint2")
    studies["prior"] = begun(folder).fit(prior="printed")
    for name, study in studies.items():
        study.save(own := folder / f"{name}-in-python.toml")
        assert content(own) == content(told[name]), name
    assert set(studies["add"].data.source.left_out) > {*LEFT_OUT}
    assert "my_play@joint2" in studies["add"].file.effects
    lrm.read_study(told["fit"], csv, mine).add("my_play@joint2").save(folder / "read.toml")
    assert content(folder / "read.toml") == content(told["add"])


@pytest.mark.slow
def test_auto_ends_alike_and_every_step_can_be_taken_back(folder: Path) -> None:
    study = begun(folder).fit()
    study.save(folder / "begun.toml")
    words = ("auto", folder / "begun.toml", folder / "data.csv", "--no-nested", "--max-effects", "1")
    code, _, stderr = run_command(*words, "--effects-file", folder / "mine.py", "-o", folder / "end.toml")
    assert code == 0, stderr
    run, end = study.auto(max_effects=1)
    end.save(folder / "end-in-python.toml")
    assert content(folder / "end-in-python.toml") == content(folder / "end.toml")
    assert [str(entry.name) for entry in end.file.history] == ["fit", "without outliers", f"add {run.steps[-1].added}"]
    read = lrm.read_study(folder / "end.toml", folder / "data.csv", folder / "mine.py")
    for _ in run.steps:
        read, end = read.undo(), end.undo()
        assert read.model.keys == end.model.keys
        assert read.model.values.tolist() == end.model.values.tolist()
        read.save(folder / "read.toml")
        end.save(folder / "back.toml")
        assert content(folder / "read.toml") == content(folder / "back.toml")
    assert content(folder / "back.toml") == content(folder / "begun.toml")
    with pytest.raises(LrmError, match="nothing to undo"):
        read.undo()


@pytest.mark.slow
def test_auto_leaves_outliers_out_of_its_model_where_it_adds_nothing(folder: Path) -> None:
    """Before: the model that it wrote was the one with them, beside the error of the one without."""
    study = begun(folder).fit()
    study.save(folder / "with.toml")
    words = ("auto", folder / "with.toml", folder / "data.csv", "--no-nested", "--max-effects", "0")
    stdout = stdout_of(*words, "--effects-file", folder / "mine.py", "-o", folder / "without.toml")
    end = lrm.read_study(folder / "without.toml", folder / "data.csv", folder / "mine.py")
    known = end.file.provenance
    assert WRONG in known.left_out
    before, after = end.file.history
    assert (before.held_out_rms_mm or 0.0) > 1.1 * (after.held_out_rms_mm or 0.0) > 0.0
    assert f"without outliers {after.held_out_rms_mm:.2f} mm" in stdout
    right = begun(folder).data.without(known.left_out)
    refitted = lrm.Study.of(right, catalogue=lrm.catalogue_with(folder / "mine.py")).fit()
    assert after.fit_rms_mm == pytest.approx(refitted.file.history[0].fit_rms_mm, rel=1e-4)


@pytest.mark.slow
def test_outliers_stay_out_in_python(folder: Path) -> None:
    data = lrm.load(folder / "data.csv", arm="two-joint").without(LEFT_OUT)
    added = lrm.add(lrm.fit(data), data, "hysteresis@joint2")
    lrm.save(added, data, folder / "added.toml")
    assert len(added.residual) < len(data)
    known = lrm.read_study(folder / "added.toml", folder / "data.csv").file.provenance
    assert WRONG in known.left_out


def test_an_added_effect_tells_the_rest_of_its_class(folder: Path) -> None:
    study = begun(folder).fit()
    screened = study.screen()
    ((name, rest),) = screened.equivalent.items()
    assert name == "servo_gain@joint1"
    assert rest
    step = study.add(name, screened).file.history[-1]
    assert (step.name, step.indistinguishable) == (StepName(ADD, name), list(rest))
    assert not {name, *rest} & step.rivals_mm.keys()


def test_an_arm_file_is_found_from_every_folder(tmp_path: Path, folder: Path) -> None:
    begun(folder).fit(parameters="offsets.*").save(folder / "here.toml")
    study = lrm.read_study(folder / "here.toml", folder / "data.csv", folder / "mine.py")
    study.save(tmp_path / "there.toml")
    assert study.file.arm == "own.toml"
    assert lrm.load_model(tmp_path / "there.toml").arm == study.model.arm
    assert arm_from(folder / "here.toml", "lrm-lab") == "lrm-lab"


def test_a_study_without_a_fit_has_no_file(folder: Path) -> None:
    with pytest.raises(LrmError, match="nothing is fitted"):
        begun(folder).save(folder / "none.toml")


def test_every_door_takes_its_steps_by_a_study() -> None:
    steps = {f"{module}.{name}" for module, name in ONLY_A_STUDY.items()}
    for path in (path for door in DOORS for path in files(door)):
        assert not steps & set(imported_names(path)), path


SAID = "loss huber; 3 poses left out: 7, 20, 21"


def noticed(*words: object) -> str:
    """Stderr of a command that succeeds, on one line."""
    code, _, stderr = run_command(*words)
    assert code == 0, stderr
    return " ".join(stderr.split())


@pytest.fixture(scope="module")
def fitted_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Measurements with four wrong positions, and a model fitted without three of them, by a loss that bears one."""
    fitted_folder = tmp_path_factory.mktemp("fitted")
    data = random_arm_data("two-joint", 5, poses=60)
    for number in (*LEFT_OUT, WRONG):
        data.tcp[data.pose == number] += [0.03, -0.03, 0.03]
    (fitted_folder / "data.csv").write_text(measurements_csv(data))
    how = ["--loss", "huber", "--leave-out", "7,20-21"]
    said = stdout_of("fit", fitted_folder / "data.csv", "--arm", "two-joint", *how, "-o", fitted_folder / "model.toml")
    assert SAID in " ".join(said.split()), said
    return fitted_folder


def provenance(path: Path) -> ProvenanceTable:
    return ProvenanceTable.model_validate(tomllib.loads(path.read_text())["provenance"])


@pytest.mark.slow
@pytest.mark.parametrize("command", ["compare", "diagnose", "propose"])
def test_reading_commands_say_and_do_as_the_fit(fitted_folder: Path, command: str) -> None:
    assert SAID in noticed(
        command, fitted_folder / "model.toml", fitted_folder / "data.csv", "--json", fitted_folder / "out.json"
    )
    if command != "propose":
        assert json.loads((fitted_folder / "out.json").read_text())["poses"] <= 57


@pytest.mark.slow
@pytest.mark.parametrize("words", [["add", "hysteresis@joint2"], ["auto", "--no-nested", "--max-effects", "1"]])
def test_steps_keep_how_the_model_was_fitted(fitted_folder: Path, words: list[str]) -> None:
    model, data, after = fitted_folder / "model.toml", fitted_folder / "data.csv", fitted_folder / "after.toml"
    command, *rest = words
    assert SAID in noticed(command, model, data, *rest, "-o", after, "--force")
    assert provenance(after).loss == "huber"
    assert set(LEFT_OUT) <= set(provenance(after).left_out)
    if command == "add":
        assert SAID in " ".join(stdout_of("undo", after, "-o", fitted_folder / "before.toml").split())
        assert (fitted_folder / "before.toml").read_text() == model.read_text()


@pytest.mark.slow
def test_other_data_keep_the_loss_but_no_pose_is_left_out(fitted_folder: Path) -> None:
    data = lrm.load(fitted_folder / "data.csv", arm="two-joint")
    (fitted_folder / "other.csv").write_text(measurements_csv(data.take(np.arange(50))))
    said = noticed("compare", fitted_folder / "model.toml", fitted_folder / "other.csv")
    assert "loss huber" in said
    assert "left out" not in said


@pytest.fixture(scope="module")
def data(fitted_folder: Path) -> Measurements:
    return lrm.load(fitted_folder / "data.csv", arm="two-joint").without(LEFT_OUT)


@pytest.mark.slow
def test_in_python_a_fit_brings_its_loss_along(data: Measurements) -> None:
    robust, plain = lrm.fit(data, loss="huber"), lrm.fit(data)
    assert robust.weight[data.pose == WRONG] < 0.2
    assert lrm.add(robust, data, "hysteresis@joint2").loss.name == "huber"
    assert lrm.auto(robust, data, max_effects=0).steps[-1].fit.loss.name == "huber"
    assert lrm.diagnose(robust.model, data, loss="huber").diagnosis.fit.loss.name == "huber"
    assert lrm.compare(robust, data).held_out.error == lrm.compare(robust.model, data, "huber").held_out.error
    assert lrm.compare(plain.model, data).held_out.error == lrm.compare(plain, data).held_out.error


def test_poses_are_read_as_the_data_of_the_fit(tmp_path: Path) -> None:
    data = random_arm_data("two-joint", 5, poses=40)
    turned = replace(data, poses=replace(data.poses, q=data.poses.q * [1.0, -1.0]))
    right, other = tmp_path / "right.csv", tmp_path / "other.csv"
    for path, measured in ((right, data), (other, turned)):
        path.write_text(measurements_csv(measured))
    model, predicted = tmp_path / "model.toml", tmp_path / "predicted.csv"
    stdout_of("fit", other, "--arm", "two-joint", "--joint-sign", "1,-1", "-o", model)
    assert "as the options" in noticed("predict", model, other, "-o", predicted)
    as_read = predicted.read_text()
    stdout_of("predict", model, right, "--joint-sign", "1,1", "-o", predicted)
    assert predicted.read_text() == as_read


def test_what_a_held_dimension_explains_is_no_evidence_for_an_effect() -> None:
    """The base stands obliquely and the fit held its angles: `offsets@base`, `offsets@joint1` were called missing."""
    arm, rng, count, noise = load_arm("two-joint"), np.random.default_rng(3), 120, 1e-4
    effects = [*effects_at(arm, "offsets"), *effects_at(arm, "compliance")]
    true = model_of(arm, effects, {"offsets.base.alpha_rad": 0.03, "offsets.base.beta_rad": 0.05})
    poses = poses_of(rng.uniform(-1.2, 1.2, (count, arm.dof)))
    tcp = solve_equilibrium(true, poses).tcp + rng.normal(0.0, noise, (count, 3))
    source = Source(Path("data.csv"), "0" * 64, arm=arm, arm_name="two-joint")
    data = Measurements.of_tcp(poses, tcp, noise, pose=np.arange(1, count + 1), source=source)
    study = Study.of(data).fit("compliance.*,offsets.joint?.theta_rad")
    course, after = study.auto()
    assert course.verdict == "nothing_missing"
    assert [step.added for step in course.steps] == [""]
    assert [str(entry.name) for entry in after.file.history] == ["fit", "all offsets and compliances"]
    before, now = (entry.held_out_rms_mm or 0.0 for entry in after.file.history)
    assert before > 10.0 * now > 0.0
    assert [notice.kind for notice in after.notices] == [NoticeKind.DIMENSIONS_HELD]
    assert len(after.model.free) == len(after.model.keys)


def test_a_run_says_where_held_dimensions_cannot_be_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    study = Study.of(lrm.load(lrm.EXAMPLE).take(np.arange(60))).fit("compliance.*")

    def refused(*_: object) -> None:
        raise LrmError("no convergence")

    monkeypatch.setattr("lrm_ident.study.study.fit_identifiable", refused)
    begun = study.with_dimensions()
    assert begun.model is study.model
    assert [notice.kind for notice in begun.notices[len(study.notices) :]] == [NoticeKind.DIMENSIONS_KEPT]
    assert notice_words(begun.notices[-1]).endswith("for what they explain: no convergence")


def test_a_run_begins_with_the_default_fit_as_it_is() -> None:
    """It holds nothing; a diagnosis judges a model of chosen parameters as it is."""
    data = lrm.load(lrm.EXAMPLE).take(np.arange(60))
    study, chosen = Study.of(data).fit(), Study.of(data).fit("compliance.*")
    assert study.with_dimensions() is study
    assert chosen.identifiable() is chosen
    stated = Study.of(data).fit(prior="printed")
    again = stated.identifiable()
    assert again.model.free == stated.model.free
    assert again.identifiable() is again
    assert chosen.with_dimensions().with_dimensions().model.free == chosen.with_dimensions().model.free
