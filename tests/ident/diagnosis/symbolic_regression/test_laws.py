"""Proposing a law: the grammar, the search, the file that it writes, and models that remember that file."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.wording import in_mm
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.diagnosis.screening.linearised_fit import LinearisedFit, linearise
from lrm_ident.diagnosis.symbolic_regression import law_columns
from lrm_ident.diagnosis.symbolic_regression.grammar import Law, extensions_at, laws_at, quantities_at
from lrm_ident.diagnosis.symbolic_regression.law_file import law_id, law_source
from lrm_ident.diagnosis.symbolic_regression.proposal import propose_law
from lrm_ident.diagnosis.symbolic_regression.search import LawColumns, LawSearch, search_laws
from lrm_ident.fitting.effect_plugins import effects_in, file_of, sha256_of
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.report.diagnosis.course import proposal_document
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.study.model_history import model_file, model_text
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, effects_at
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.model_file import load_model
from lrm_math.model.step_name import ADD, FIT, StepName
from tests.ident.diagnosis.test_diagnose import base_fit
from tests.support.commands import stdout_of
from tests.support.sweep import examples, seeds
from validation.hidden_effects.case import Case, hidden, nothing, on
from validation.hidden_effects.data import write_data
from validation.synthetic import FormulaJoint


def some_poses(seed: int, count: int = 40) -> tuple[Poses, Array]:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.7, 1.7, (count, 3))
    load, side = rng.choice([0.0, 0.07], count), np.sign(rng.normal(size=(count, 3)))
    return Poses(q, load, side, np.linspace(0.0, 900.0, count)), rng.normal(size=(count, 3))


SUM = on("three-joint", hidden("report", "sum", None, lambda _: FormulaJoint(2, 0.02, "np.sin(q[1] + q[3])")))
PRODUCT = on(
    "three-joint",
    hidden("report", "product", None, lambda _: FormulaJoint(2, 0.03, "np.sin(q[1]) * np.sin(q[3] + 0.7)")),
)
NOTHING = on("three-joint", nothing("report"))


def three_joints() -> Arm:
    return load_arm(str(SUM.arm_file))


def case_data(case: Case, folder: Path, poses: int = 90) -> Measurements:
    return load_measurements(write_data(case, 1, poses, folder)[0], three_joints())


def test_every_law_of_the_grammar_is_another_and_can_be_evaluated() -> None:
    poses, torque = some_poses(0)
    laws = list(laws_at(1, quantities_at(1, poses, torque)))
    formulas = [law.formula for law in laws]
    assert len(set(formulas)) == len(formulas) > 300
    for law in laws:
        values = law.values(poses, torque)
        assert values.shape == (40, len(law.terms))
        assert np.isfinite(values).all()
    for wanted in ("a sin(q1 + q3) + b cos(q1 + q3)", "a sin(5 * q2) + b cos(5 * q2)", "a tau * side", "a q1 * load"):
        assert f"δq2 = {wanted}" in formulas
    assert "δq2 = a abs(tau3)" in formulas
    assert "δq2 = a tau3 * side" not in formulas
    assert {"δd2 = a time", "δd2 = a tau1"} < {law.formula for law in some_extensions(poses, torque)}


def test_waves_places_and_widths_of_the_laws_are_those_that_are_stated() -> None:
    """Six waves a turn of an angle, three of a sum of two, two as a factor; a place every 0.4 rad as far as 1.2."""
    poses, torque = some_poses(0)
    text = "\n".join(law.formula for law in laws_at(1, quantities_at(1, poses, torque)))

    def numbers(pattern: str) -> set[float]:
        return {float(number.replace(" ", "")) for number in re.findall(pattern, text)}

    assert numbers(r"a sin\((\d) \* q2\) \+ b cos") == {2, 3, 4, 5, 6}
    assert numbers(r"a sin\((\d) \* \(q1 \+ q3\)\)") == {2, 3}
    assert numbers(r"a sin\((\d) \* q1\) \* \w+\(q3") == numbers(r"\* sin\((\d) \* q3\)") == {2}
    assert numbers(r"maximum\(q2 ([+-] [\d.]+),") == {-1.2, -0.8, -0.4, 0.4, 0.8, 1.2}
    for shape in ("tanh", "exp"):
        assert numbers(rf"{shape}\(-?\(\(?q2[^)]*\) / ([\d.]+)\)") == {0.4}


@pytest.mark.parametrize(("count", "curved"), [(2, False), (3, True)])
def test_of_two_values_only_a_line_is_a_law(count: int, curved: bool) -> None:
    poses, torque = some_poses(0)
    loads = replace(poses, payload=0.02 * (np.arange(40) % count))
    formulas = {law.formula for law in laws_at(1, quantities_at(1, loads, torque))}
    assert "δq2 = a load" in formulas
    assert ("δq2 = a load^2" in formulas) is curved


def test_a_term_that_hardly_varies_is_a_constant() -> None:
    wave = np.where(np.arange(40) % 2, 1.0, -1.0)[:, None]
    assert not law_columns._fingerprint(1.0 + 0.018 * wave)
    assert law_columns._fingerprint(1.0 + 0.022 * wave)


def some_extensions(poses: Poses, torque: Array) -> list[Law]:
    return list(extensions_at(1, "d", quantities_at(1, poses, torque)))


@pytest.mark.long
@examples(7, 15)
@given(st.integers(0, 2**32 - 1))
def test_a_written_law_moves_the_joint_as_its_formula_says(
    lab: Arm, tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    poses, torque = some_poses(seed % 1000)
    rng = np.random.default_rng(seed)
    laws = [*laws_at(1, quantities_at(1, poses, torque)), *some_extensions(poses, torque)]
    law: Law = laws[int(rng.integers(len(laws)))]
    file = tmp_path_factory.mktemp("law") / "law.py"
    file.write_text(law_source(law, (0.02,) * len(law.terms), "some.csv", "facts"), encoding="utf-8")
    (kind,) = effects_in(file)
    effect, p = kind(lab, "joint2"), rng.normal(size=len(law.terms))
    felt = [torque[:, int(key[5]) - 1] for key in effect.load_slots]
    (moved,) = effect.amounts(poses, felt, p.tolist())
    np.testing.assert_allclose(moved, law.values(poses, torque) @ p, atol=1e-12)
    assert effect.id == law_id(law)
    assert bool(effect.load_slots) == ("tau" in law.formula)
    assert effect.targets == (law.key,)


TRUE = 17


def made_up(seed: int, signal: float, axes: int = 3) -> tuple[LawSearch, LinearisedFit, LawColumns]:
    """A search among 40 random laws of one or two terms, of which number 17 is true; so many `axes` are measured."""
    rng = np.random.default_rng(seed)
    motions = rng.normal(size=(300, 61)) * 1e-3
    motions[:, 60] = 0.0
    first = np.concatenate([np.arange(20), np.arange(20, 60, 2)])
    second = np.concatenate([np.full(20, 60), np.arange(21, 60, 2)])
    poses, torque = some_poses(0)
    bank = list(laws_at(0, quantities_at(0, poses, torque)))
    one = next(law for law in bank if len(law.terms) == 1)
    two = next(law for law in bank if len(law.terms) == 2)
    group = LawColumns((one,) * 20 + (two,) * 20, motions, first, second)
    residual = rng.normal(size=300) * 1e-3 + signal * motions[:, TRUE]
    folds = [np.arange(100)[k::10] for k in range(10)]
    measured = np.arange(300) % 3 < axes
    group = replace(group, motions=group.motions * measured[:, None])
    linear = linearise(rng.normal(size=(300, 4)) * measured[:, None], residual * measured, folds, 1e-3)
    assert linear.degrees_of_freedom == 100 * axes - 4
    return search_laws(linear, [group]), linear, group


@pytest.mark.parametrize("seed", seeds(1, 3))
def test_the_search_is_what_the_linearised_fit_says_of_each_law(seed: int) -> None:
    """Oracle: the same law through `LinearisedFit.explain`."""
    search, linear, group = made_up(seed, 0.5)
    for i in (0, 17, 25, 39):
        columns = [group.first[i], group.second[i]][: len(group.laws[i].terms)]
        alone = linear.explain(linear.project(group.motions[:, columns]))
        np.testing.assert_allclose(search.squares[:, i], alone.held_out, rtol=1e-7)


def test_of_numbers_that_were_not_measured_no_law_is_made() -> None:
    """The p value of the best law of noise is as often below a level as it says, also where one axis was measured."""
    p_values = np.array([made_up(seed, 0.0, axes=1)[0].p_value for seed in range(20)])
    assert np.median(p_values) > 0.2
    assert np.count_nonzero(p_values < 0.05) <= 4


@pytest.mark.parametrize("seed", seeds(1, 3))
def test_a_true_law_beats_the_noise_and_none_does_not(seed: int) -> None:
    search, linear, _ = made_up(seed, 1.0)
    assert int(search.bic_gain.argmax()) == TRUE
    assert search.p_value < 0.01
    assert search.nested.mean() < 0.7 * linear.baseline.held_out.mean()
    search, linear, _ = made_up(seed, 0.0)
    assert search.p_value > 0.01
    assert search.nested.mean() > 0.97 * linear.baseline.held_out.mean()


@pytest.mark.slow
def test_a_law_is_proposed_written_added_and_remembered(tmp_path: Path) -> None:
    data, arm = case_data(SUM, tmp_path), three_joints()
    found = propose_law(base_fit(arm, data), data)
    assert found.best.law.formula == "δq2 = a sin(q1 + q3) + b cos(q1 + q3)"
    assert found.best.error.rms < 1.25 * 0.3e-3 * np.sqrt(3.0) < found.before.rms
    assert proposal_document(found).values["proposed"] == {"joint": 2, "formula": found.best.law.formula}
    assert found.best.law.formula in found._repr_html_()
    assert found.best.law.formula in repr(found)
    assert len(repr(found)) < 200

    law = tmp_path / "sway.py"
    law.write_text(found.best.source, encoding="utf-8")
    (kind,) = effects_in(law)
    fitted = add_effects(base_fit(arm, data), data, [kind(arm, "joint2")])
    file = model_file(fitted, data, HeldOutResidual(None), str(SUM.arm_file), StepName(ADD))
    assert file.provenance.effects_file == law.resolve().as_posix()
    assert file.provenance.effects_sha256 == sha256_of(law)
    path = tmp_path / "m.toml"
    path.write_text(model_text(file), encoding="utf-8")
    assert load_model(path, (*CATALOGUE, kind)).value("law_q1_q3.joint2.a_rad") != 0.0
    with pytest.raises(FileError, match=re.escape(f"effects of its own, from {law.resolve()} (sha256")):
        load_model(path)
    law.rename(tmp_path / "elsewhere.py")
    with pytest.raises(FileError, match=r"sway\.py, which is gone"):
        load_model(path)


@pytest.mark.slow
def test_the_file_of_a_sum_says_what_its_last_term_was_added_to(tmp_path: Path) -> None:
    """Before: the error of the model with the other terms was said to be that of the model alone."""
    data, arm = case_data(PRODUCT, tmp_path), three_joints()
    found = propose_law(base_fit(arm, data), data)
    law = found.best.law
    assert len(law.terms) == 2
    errors = re.findall(r"the model (.+)\nhas (\S+) mm; with", found.best.source)
    ((beside, error),) = errors
    assert beside in {f"with δq2 = a {term}" for term in re.findall(r"[ab] (sin\(q1\) \* \w+\(q3\))", law.formula)}
    assert float(error) < float(in_mm(found.before.rms))


@pytest.mark.slow
def test_a_length_that_grows_is_proposed_as_one(tmp_path: Path) -> None:
    """A law's own file makes the data: the length a of link 2 follows the size of joint 3's angle."""
    data, arm = case_data(NOTHING, tmp_path), three_joints()
    fitted = base_fit(arm, data)
    laws = extensions_at(1, "a", quantities_at(1, data.poses, solve_equilibrium(fitted, data.poses).joint_torque))
    law = next(one for one in laws if one.formula == "δa2 = a abs(q3)")
    file = tmp_path / "law.py"
    file.write_text(law_source(law, (0.002,), "some.csv", "facts"), encoding="utf-8")
    (kind,) = effects_in(file)
    grown = model_of(arm, [kind(arm, "joint2")]).with_values([0.004])
    moved = solve_equilibrium(grown, data.poses).tcp - solve_equilibrium(model_of(arm, ()), data.poses).tcp
    found = propose_law(fitted, data.with_tcp(data.tcp + moved))
    assert found.best.law.formula == law.formula
    assert found.best.error.rms < 0.5 * found.before.rms


@pytest.mark.slow
def test_no_law_where_nothing_is_hidden(tmp_path: Path) -> None:
    data, arm = case_data(NOTHING, tmp_path), three_joints()
    found = propose_law(base_fit(arm, data), data)
    assert found.best is None
    assert found.reason
    assert "No formula is proposed" in str(proposal_document(found).blocks[0])


def test_a_model_without_effects_of_its_own_names_no_file(tmp_path: Path) -> None:
    data, arm = case_data(NOTHING, tmp_path, 60), three_joints()
    fitted = fit(model_of(arm, effects_at(arm, "offsets@base")), data)
    file = model_file(fitted, data, HeldOutResidual(None), str(SUM.arm_file), StepName(FIT))
    assert file_of(fitted.model.effects) is None
    assert file.provenance.effects_file is None
    assert "effects_file" not in model_text(file)


@pytest.mark.slow
def test_the_command_writes_an_effect_file_and_says_how_to_add_it(tmp_path: Path) -> None:
    data, _ = write_data(SUM, 1, 90, tmp_path)
    model, law = tmp_path / "m.toml", tmp_path / "law.py"
    stdout_of("fit", data, "--arm", SUM.arm_file, "-o", model)
    said = stdout_of("propose", model, data, "-o", law)
    assert "Proposed: δq2 = " in said
    (name,) = re.findall(r"(law_\S+)@joint2 --effects-file", said)
    assert [kind.id for kind in effects_in(law)] == [name]
