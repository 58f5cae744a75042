"""One spine: the commands, the Python API and a study give the same files, whatever was left out or brought along."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import lrm_ident as lrm
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.study.inputs import arm_from
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.step_name import ADD, StepName
from tests.conftest import ROOT
from tests.support.commands import run_command, stdout_of
from tests.support.source_files import files, imported_names
from validation.misreadings import random_arm_data

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
    assert set(studies["add"].data.left_out) > {*LEFT_OUT}
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
    assert known is not None
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
    assert known is not None
    assert WRONG in known.left_out


def test_an_added_effect_tells_the_rest_of_its_class(folder: Path) -> None:
    study = begun(folder).fit()
    screened = study.screen()
    ((name, rest),) = screened.equivalent.items()
    assert name == "servo_gain@joint1"
    assert rest
    step = study.add(name, screened).file.history[-1]
    assert (step.name, step.indistinguishable) == (StepName(ADD, name), list(rest))
    assert step.rivals_mm is not None
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
