"""Laws of a residual field: smooth, zero beyond its data, derivatives as computed, the same when read from its file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, FIELDS, FREE_FORMS, effects_at
from lrm_math.effects.derivatives import amounts_within, by_angles, by_parameters
from lrm_math.effects.field.residual_field import JOINTS_TOGETHER, WAVES, WAVES_ALONE, ResidualField, wave_numbers
from lrm_math.effects.measured_range import FADE, MeasuredRange
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.deployed_model import deployed_part, field_of, named_part
from lrm_math.model.derivatives import joint_jacobian, parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.model_file import ModelFile, as_tables, load_model, parameter_tables, range_table
from tests.support.sweep import examples

LAB = load_arm("lrm-lab")
FIELD = ResidualField(LAB, "tool")
BEYOND = [row for row, parameter in enumerate(FIELD.parameters) if "beyond" in parameter.name]


class Learned:
    """A field of random coefficients, most of them zero, over a random range."""

    def __init__(self, seed: int, count: int = 60) -> None:
        rng = np.random.default_rng(seed)
        lower, upper = np.sort(rng.uniform(-1.5, 1.5, (2, LAB.dof)), axis=0)
        upper = np.maximum(upper, lower + 0.3)
        self.lower, self.upper, self.rng = lower, upper, rng
        self.within = MeasuredRange(tuple(zip(lower.tolist(), upper.tolist(), strict=True)), (0.0, 0.0))
        self.p = np.zeros(len(FIELD.parameters))
        self.p[rng.choice(len(self.p), count, replace=False)] = rng.normal(0.0, 1e-3, count)
        self.p[BEYOND] = 0.0

    def inside(self, count: int = 30) -> Poses:
        return poses_of(self.rng.uniform(self.lower, self.upper, (count, LAB.dof)))

    def at(self, poses: Poses) -> Array:
        amounts = amounts_within(FIELD, poses, (), self.p.tolist(), self.within)
        return np.stack([np.broadcast_to(amount, len(poses)) for amount in amounts], axis=1)

    @property
    def model(self) -> Model:
        causes = effects_at(LAB, "compliance")
        field = [key for key, value in zip(FIELD.keys, self.p, strict=True) if value]
        springs = tuple(key for effect in causes for key in effect.keys)
        values = np.concatenate([np.full(len(springs), 0.05), self.p])
        return Model(LAB, (*causes, FIELD), values, (*springs, *field), self.within)


@given(seed=st.integers(0, 2**32 - 1), joint=st.integers(0, LAB.dof - 1), side=st.sampled_from([-1, 1]))
@examples(20, 40)
def test_it_is_zero_far_beyond_its_data(seed: int, joint: int, side: int) -> None:
    """Six widths of the way beyond the range of any joint nothing is left; further out neither."""
    field = Learned(seed)
    q = field.inside().q
    way = 6.0 * FADE * (field.upper - field.lower)[joint]
    q[:, joint] = (field.upper if side > 0 else field.lower)[joint] + side * (way + field.rng.uniform(0.0, 3.0, len(q)))
    assert np.abs(field.at(poses_of(q))).max() < 1e-15
    assert np.abs(field.at(field.inside())).max() > 1e-5


@given(seed=st.integers(0, 2**32 - 1))
@examples(10, 20)
def test_nowhere_does_it_jump(seed: int) -> None:
    """Along a straight line in and out of the range its steps shrink with the line's."""
    field = Learned(seed)
    ends = field.rng.uniform(-2.0, 2.0, (2, LAB.dof))
    steps = [np.abs(np.diff(field.at(poses_of(np.linspace(*ends, n))), axis=0)).max() for n in (2001, 4001)]
    assert steps[1] < 0.6 * steps[0] + 1e-12


@pytest.mark.long
@given(seed=st.integers(0, 2**32 - 1))
@examples(10, 20)
def test_amounts_are_the_basis_times_the_coefficients(seed: int) -> None:
    field = Learned(seed)
    poses = poses_of(field.rng.uniform(-2.0, 2.0, (5, LAB.dof)))
    basis = by_parameters(FIELD, poses, (), field.p.tolist(), field.within)
    rows = np.array([[np.broadcast_to(amount, 5) for amount in amounts] for amounts in basis])
    np.testing.assert_allclose(np.einsum("p,pkn->nk", field.p, rows), field.at(poses), atol=1e-15)


@pytest.mark.parametrize("spread", [1.0, 1.3])
def test_derivatives_by_angles(spread: float) -> None:
    """Against central differences, within the range and on the way to zero."""
    field = Learned(3)
    middle = 0.5 * (field.lower + field.upper)
    poses = poses_of(middle + spread * (field.inside().q - middle))
    exact = by_angles(FIELD, poses, (), field.p.tolist(), field.within)
    for joint, amounts in enumerate(exact):
        plus, minus = (field.at(poses.perturbed(joint, h)) for h in (1e-6, -1e-6))
        ours = np.stack([np.broadcast_to(amount, len(poses)) for amount in amounts], axis=1)
        np.testing.assert_allclose(ours, (plus - minus) / 2e-6, atol=1e-9)


def test_derivatives_of_the_tcp_through_the_equilibrium() -> None:
    field = Learned(5)
    model, poses = field.model, field.inside(6)
    J = joint_jacobian(solve_equilibrium(model, poses, tolerance=1e-13))
    for joint in range(LAB.dof):
        plus, minus = (solve_equilibrium(model, poses.perturbed(joint, h), tolerance=1e-13).tcp for h in (1e-6, -1e-6))
        np.testing.assert_allclose(J[:, :, joint], (plus - minus) / 2e-6, atol=3e-8)
    keys = model.free[-3:]
    by_key = parameter_jacobian(solve_equilibrium(model, poses), keys)
    for column, key in enumerate(keys):
        values = [model.values.copy(), model.values.copy()]
        for sign, changed in zip((1, -1), values, strict=True):
            changed[model.position(key)] += sign * 1e-5
        plus, minus = (solve_equilibrium(model.with_values(v), poses, tolerance=1e-13).tcp for v in values)
        np.testing.assert_allclose(by_key[:, :, column], (plus - minus) / 2e-5, atol=1e-8)


@given(seed=st.integers(0, 2**32 - 1))
@examples(2, 5)
def test_a_model_read_from_its_file_predicts_the_same(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    field = Learned(seed)
    model, path = field.model, Path(tmp_path_factory.mktemp("model") / "model.toml")
    file = ModelFile(
        schema="lrm/model/1", arm="lrm-lab", effects=["compliance", "residual_field"],
        parameters=parameter_tables(model), range=range_table(model),
    )  # fmt: skip
    path.write_text(tomli_w.dumps(as_tables(file)))
    read, poses = load_model(path), poses_of(field.rng.uniform(-1.6, 1.6, (50, LAB.dof)))
    np.testing.assert_allclose(solve_equilibrium(read, poses).tcp, solve_equilibrium(model, poses).tcp, atol=1e-13)
    assert len(file.parameters) == len(model.free)


def test_it_is_no_candidate_and_can_be_taken_out() -> None:
    model = Learned(1).model
    assert (ResidualField,) == FIELDS
    assert ResidualField not in (*CATALOGUE, *FREE_FORMS)
    assert field_of(model) == FIELD
    assert field_of(named_part(model)) is None
    assert {effect.id for effect in named_part(model).effects} == {"compliance"}
    np.testing.assert_array_equal(named_part(model).values, model.values[: -len(FIELD.keys)])
    assert field_of(deployed_part(model)) == FIELD, "the rover compensates it"


@pytest.mark.parametrize("joints", [1, 2, 6, 7])
def test_every_product_of_few_joints_is_there_once(joints: int) -> None:
    waves = np.array(wave_numbers(joints))
    assert len(np.unique(waves, axis=0)) == len(waves)
    several = (waves > 0).sum(axis=1) > 1
    assert waves[several].max(initial=WAVES) == WAVES
    assert (waves[~several].max(axis=0) == WAVES_ALONE).all()
    assert (waves > 0).sum(axis=1).max() == min(joints, JOINTS_TOGETHER)


def test_its_axes_turn_with_joint_1() -> None:
    """Constants alone for coefficients: it is fixed to what joint 1 turns."""
    p = np.zeros(len(FIELD.parameters))
    constants = [row for row, parameter in enumerate(FIELD.parameters) if parameter.name[1:] == "0" * LAB.dof + "_mm"]
    p[constants] = 1e-3, 2e-3, 3e-3
    q = np.zeros((5, LAB.dof))
    q[:, 0] = np.linspace(-1.0, 1.0, 5)
    within = MeasuredRange(((-2.0, 2.0),) * LAB.dof, (0.0, 0.0))
    moved = np.stack(
        np.broadcast_arrays(*amounts_within(FIELD, poses_of(q), (), p.tolist(), within), q[:, 0])[:3], axis=1
    )
    chain = chain_of(LAB)
    turned = frames(chain, chain.values(list(q.T)), 5)[:, 1, :3, :3]
    fixed = np.einsum("nji,nj->ni", turned, moved)
    np.testing.assert_allclose(fixed, np.broadcast_to(fixed[0], fixed.shape), atol=1e-15)
    assert np.linalg.norm(fixed[0]) == pytest.approx(np.linalg.norm(p[constants]))
