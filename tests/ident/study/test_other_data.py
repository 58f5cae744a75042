"""Effects of one measurement session say nothing of other data: neither numbers nor times of poses there matter."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lrm_ident as lrm
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.report.model_report import quick_report
from lrm_ident.study.model_history import model_text
from lrm_ident.study.notices import NoticeKind
from lrm_ident.study.other_data import model_for_data
from lrm_ident.study.study import Study
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import CATALOGUE, effect_names, effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import of_a_session
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import HistoryTable, ModelFile, ProvenanceTable, parameter_tables
from tests.support.commands import run_command, stdout_of
from tests.support.sweep import examples

pytestmark = pytest.mark.long

ARM, COUNT, NAME = "two-joint", 12, "data.csv"
HERE = "0" * 64
LASTING = ("offsets@joint1", "compliance@joint2")
OF_A_SESSION = tuple(
    f"{kind.id}@{place}"
    for kind in CATALOGUE
    for place in kind.places(load_arm(ARM))
    if of_a_session(kind(load_arm(ARM), place))
)


def model_with(arm: Arm, names: Sequence[str], seed: int = 0) -> Model:
    """A model with every parameter of these effects at some size, changes in the middle of the poses."""
    empty = model_of(arm, [effect for name in names for effect in effects_at(arm, name)])
    sizes = np.random.default_rng(seed).uniform(0.5, 2.0, len(empty.keys))
    values = {
        key: (COUNT / 2 if parameter.unit == "pose" else size * parameter.typical)
        for key, parameter, size in zip(empty.keys, empty.parameters, sizes, strict=True)
    }
    return replace(model_of(arm, empty.effects, values), free=empty.keys)


def written(model: Model, folder: Path, sha256: str) -> Path:
    """Its file, as of a fit to data of that hash."""
    said = ProvenanceTable(data=NAME, data_sha256=sha256, poses=COUNT, tool="test", date="2026-01-01")
    parts = {"effects": effect_names(model.effects), "parameters": parameter_tables(model), "provenance": said}
    entry = HistoryTable(step="fit", fit_rms_mm=1.0, held_out_rms_mm=None, **parts)  # type: ignore[arg-type]
    path = folder / "model.toml"
    path.write_text(model_text(ModelFile(schema="lrm/model/1", arm=ARM, history=[entry], **parts)))  # type: ignore[arg-type]
    return path


def measured(numbers: Sequence[int], t0: float, session: int) -> Measurements:
    """The same tips at the same poses, numbered and timed as told."""
    arm, pose = load_arm(ARM), np.array(numbers)
    plain = poses_of(np.random.default_rng(1).uniform(-1.0, 1.0, (COUNT, arm.dof)))
    course = 60.0 * np.arange(COUNT)
    poses = replace(plain, number=pose, t=t0 + course, session=np.full(COUNT, float(session)), running=course)
    tcp = solve_equilibrium(model_of(arm, ()), plain).tcp
    return Measurements.of_tcp(poses, tcp, pose=pose, source=Source(arm=arm, arm_name=ARM))


def saved(data: Measurements, folder: Path) -> Path:
    path = folder / NAME
    path.write_text(measurements_csv(data))
    return path


IN_ORDER = measured(range(1, COUNT + 1), 0.0, 1)


@examples(6, 12)
@given(
    names=st.lists(st.sampled_from(OF_A_SESSION), min_size=1, max_size=4, unique=True),
    first=st.integers(1, 10_000),
    order=st.permutations(range(COUNT)),
    t0=st.floats(0.0, 1e6),
    session=st.integers(1, 9),
)
def test_numbers_and_times_may_differ(names: list[str], first: int, order: list[int], t0: float, session: int) -> None:
    """Predictions and errors are those of the model without such effects, under the same name of the file as well."""
    arm = load_arm(ARM)
    lasting = model_with(arm, LASTING)
    known = dict(zip(lasting.keys, lasting.values.tolist(), strict=True))
    whole = model_with(arm, (*LASTING, *names)).with_values_of(lasting.keys, list(known.values()))
    with tempfile.TemporaryDirectory() as folder:
        model = written(whole, Path(folder), HERE)
        data = saved(measured([first + row for row in order], t0, session), Path(folder))
        study = lrm.read_study(model, data)
        assert {effect.name for effect in study.model.effects} == set(LASTING)
        (left_out,) = (notice for notice in study.notices if notice.kind is NoticeKind.OTHER_DATA)
        assert left_out.names[0] == data.name
        assert {*names} <= {*left_out.names[1:]}
        assert str(left_out).startswith(
            f"{data.name} is not what the model was fitted to; left out, as of that session"
        )
        right = solve_equilibrium(lasting, study.data.poses).tcp
        np.testing.assert_allclose(study.compare().residual, study.data.tcp - right, atol=1e-12)
        np.testing.assert_allclose(quick_report(study).field.steps[-1].residual, study.data.tcp - right, atol=1e-12)
        with pytest.warns(UserWarning, match="of that session alone"):
            told = lrm.predict(lrm.load_model(model), lrm.load_poses(data, arm))
        np.testing.assert_allclose(told, right, atol=1e-12)


@examples(5, 10)
@given(names=st.lists(st.sampled_from(OF_A_SESSION), min_size=1, max_size=3, unique=True), more=st.booleans())
def test_on_its_own_data_the_model_is_whole(names: list[str], more: bool) -> None:
    """Also where rows were added to the file, and on any part of it, as a cross-validation takes."""
    arm = load_arm(ARM)
    with tempfile.TemporaryDirectory() as folder:
        data = saved(IN_ORDER, Path(folder))
        sha256 = lrm.load(data, arm=ARM).source.sha256
        model = written(model_with(arm, (*LASTING, *names)), Path(folder), sha256)
        if more:
            with data.open("a") as file:
                row = data.read_text().splitlines()[-1].split(",")
                file.write(",".join([str(COUNT + 1), *row[1:-1], str(COUNT + 1)]) + "\n")
        study = lrm.read_study(model, data)
        assert {effect.name for effect in study.model.effects} == {*LASTING, *names}
        assert NoticeKind.OTHER_DATA not in {notice.kind for notice in study.notices}
        part = study.data.take(np.arange(3, COUNT))
        whole = solve_equilibrium(lrm.load_model(model), part.poses).tcp
        if not more:
            np.testing.assert_array_equal(lrm.predict(lrm.load_model(model), part.poses), whole)
            np.testing.assert_array_equal(lrm.compare(lrm.load_model(model), part).residual, part.tcp - whole)


def test_the_commands_say_what_they_leave_out(tmp_path: Path) -> None:
    """`predict`, `compare` and `fit --start`: one line on stderr, and results without those effects."""
    arm = load_arm(ARM)
    model = written(model_with(arm, (*LASTING, "change_point@base", "drift@joint2")), tmp_path, HERE)
    data, out = saved(IN_ORDER, tmp_path), tmp_path / "out.csv"
    start = ["fit", data, "--arm", ARM, "--start", model]
    for words in (["predict", model, data, "-o", out], ["compare", model, data], start):
        code, _, said = run_command(*words)
        assert code == 0, said
        line = "left out, as of that session alone: change_point@base, drift@joint2"
        assert " ".join(said.split()).count(line) == 1
    stdout_of("compare", model, data, "--json", tmp_path / "c.json")
    before = json.loads((tmp_path / "c.json").read_text())["error"]
    saved(measured(range(901, 901 + COUNT), 5e4, 7), tmp_path)
    stdout_of("compare", model, data, "--json", tmp_path / "c.json")
    assert json.loads((tmp_path / "c.json").read_text())["error"] == before


def test_a_model_of_no_data_is_whole_on_any() -> None:
    model = model_with(load_arm(ARM), (*LASTING, "change_point@joint2"))
    assert model.fitted_to is None
    found, notices = model_for_data(model, None, HERE)
    assert (found is model, notices) == (True, ())
    assert model_for_data(replace(model, fitted_to="1" * 64), None, HERE)[0] is not model


def test_a_fit_knows_its_data_at_every_step() -> None:
    """A fit in this process and one from a file: steps on the same measurements keep what belongs to them."""
    data = replace(IN_ORDER, source=replace(IN_ORDER.source, sha256=HERE))
    study = Study.of(data, (*LASTING, "change_point@joint2")).fit("offsets.joint1.theta_rad")
    assert study.model.fitted_to == HERE
    fitted = study.taken.fit
    assert {effect.name for effect in lrm.compare(fitted, data).equilibrium.model.effects} == {
        *LASTING,
        "change_point@joint2",
    }
    with pytest.warns(UserWarning, match="change_point@joint2"):
        elsewhere = lrm.compare(fitted, replace(data, source=replace(data.source, sha256="1" * 64)))
    assert {effect.name for effect in elsewhere.equilibrium.model.effects} == set(LASTING)
