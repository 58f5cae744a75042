"""Model files cut off, mistyped or absurd, and arms beyond the kernel's maxima: an answer or one clear error."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.effects import CATALOGUE, compensable, effects_at
from lrm_math.errors import LrmError
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.goal import point, pose
from lrm_math.ik.kernel.kernel_model import KernelModel, with_laws
from lrm_math.ik.methods import Direct
from lrm_math.ik.nominal import NominalSolver
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model
from tests.support.random_arms import random_arm
from tests.support.sweep import examples

TABLE_B2 = Path(__file__).parents[1] / "models" / "thesis-table-b2-option-1.toml"
TEXT = TABLE_B2.read_text(encoding="utf-8")
VALUES = [n for n, line in enumerate(TEXT.splitlines()) if " = " in line]
ABSURD = ["nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "1e30", "-7", '"text"', "true", "[]", "[1, 2]", "{}", ""]
GOALS = (pose((0.2, 0.05, 0.25), np.eye(3)), point((0.2, 0.0, 0.2)), point((9.0, 9.0, 9.0)))


def answered(text: str) -> list[str]:
    """Answer of a solver to a model file: the words of its answers, or of its one error."""
    with TemporaryDirectory() as folder:
        file = Path(folder, "model.toml")
        file.write_text(text, encoding="utf-8")
        try:
            return words(load_model(file))
        except LrmError as error:
            return [str(error)]


def words(model: Model) -> list[str]:
    """Words of answers to a few goals, all of whose numbers are finite."""
    solver, out = CalibratedSolver.of(model), []
    for goal in GOALS:
        try:
            reply = solver.solve(goal, 0.02, method=Direct())
        except LrmError as error:
            out.append(str(error))
        else:
            assert all(math.isfinite(x) for branch in getattr(reply, "branches", ()) for x in branch.q)
            out.append(str(reply))
    return out


@examples(15, 30)
@given(end=st.integers(0, len(TEXT)))
def test_a_file_cut_off_anywhere_is_answered_or_one_clear_line(end: int) -> None:
    said = answered(TEXT[:end])
    assert all(said)
    assert all("\n" not in line for line in said)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
@examples(20, 40)
@given(row=st.sampled_from(VALUES), value=st.sampled_from(ABSURD))
def test_any_value_may_be_absurd(row: int, value: str) -> None:
    lines = TEXT.splitlines()
    lines[row] = f"{lines[row].split(' = ')[0]} = {value}"
    said = answered("\n".join(lines))
    assert all(said)
    assert all("\n" not in line for line in said)


@examples(15, 30)
@given(at=st.integers(0, len(TEXT) - 1), byte=st.integers(0, 255))
def test_any_byte_may_be_another(at: int, byte: int) -> None:
    with TemporaryDirectory() as folder:
        file, data = Path(folder, "model.toml"), bytearray(TEXT.encode())
        data[at] = byte
        file.write_bytes(bytes(data))
        try:
            said = words(load_model(file))
        except LrmError as error:
            said = [str(error)]
    assert all(said)


@pytest.mark.parametrize("joints", [17, 40])
def test_an_arm_with_more_joints_than_the_kernel_has_room_for(joints: int) -> None:
    arm = random_arm(0, joints)
    with pytest.raises(LrmError, match=rf"{joints} joints; the kernel of inverse kinematics has room for 16"):
        CalibratedSolver.of(model_of(arm, ())).warm_up()
    with pytest.raises(LrmError, match="has room for 16"):
        NominalSolver.of(arm).solve(GOALS[0])


def flat(arm: Arm) -> KernelModel:
    """The packed arm as drawn."""
    return NominalSolver.of(arm).packed


def test_every_effect_of_the_catalogue_at_once_fits_on_ten_joints() -> None:
    arm = random_arm(3, 10)
    effects = [effect for kind in CATALOGUE if compensable(kind) for effect in effects_at(arm, kind.id)]
    model = model_of(arm, [effect for effect in effects if compensable(effect)])
    assert all(words(model))


@pytest.mark.parametrize(
    ("pack", "says"),
    [
        (lambda arm: flat(replace(arm, bodies=arm.bodies * 3)), "bodies; the kernel"),
        (lambda arm: flat(arm).with_springs(np.zeros(17), np.ones((17, 17))), "289 springs; the kernel .* for 256"),
        (lambda arm: with_laws(flat(arm), [(0, 0, (0.1, 0.1))] * 97, True), "97 joint laws; the kernel .* for 96"),
        (
            lambda arm: flat(arm).with_library(
                np.tile(np.eye(4), (2049, 1, 1)), np.zeros((2049, 6)), np.zeros((2049, 6))
            ),
            "2049 library poses; the kernel .* for 2048",
        ),
        (lambda arm: flat(arm).with_(zero=np.zeros(49)), "49 numbers in zero; the kernel .* for 48"),
    ],
)
def test_more_of_anything_than_the_kernel_has_room_for(pack: Callable[[Arm], KernelModel], says: str) -> None:
    with pytest.raises(LrmError, match=says):
        pack(random_arm(3, 6))


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
@pytest.mark.parametrize("size", [1e2, 1e8, 1e30, 1e300])
def test_parameters_of_any_size(size: float) -> None:
    """Nothing settles, or the loads overflow: the answer says so."""
    model = load_model(TABLE_B2)
    said = []
    try:
        said = words(model.with_values(np.array(model.values) * size))
    except LrmError as error:
        said = [str(error)]
    assert all(said)
