"""Candidate laws that go on beyond the measured range."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.study.model_history import as_written
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.errors import FileError, NoEquilibrium
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model import uncertainty
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import ModelFile, parameter_tables, range_table, to_model
from lrm_math.model.uncertainty import open_covariance, position_uncertainty
from lrm_math.model.unseen_angles import beyond_range

LAB = load_arm("lrm-lab")
JOINT = 1


def upper_half(effect: str, **values: float) -> Model:
    """An effect of joint 2, of which the parameters with values were fitted at angles above zero."""
    names = ("offsets", "compliance", effect)
    keys = {f"{effect.partition('@')[0]}.joint2.{name}": value for name, value in values.items()}
    springs = {f"compliance.joint{joint}.k_rad_per_Nm": 0.05 for joint in range(1, LAB.dof + 1)}
    model = model_of(LAB, [one for name in names for one in effects_at(LAB, name)], keys | springs)
    angles = tuple((0.0 if joint == JOINT else one.lower, one.upper) for joint, one in enumerate(LAB.joints))
    return replace(model, free=(*keys, *springs), within=MeasuredRange(angles, (0.0, 0.0)))


def candidate(model: Model, *names: str) -> Model:
    assert model.within is not None
    return replace(model, within=replace(model.within, candidates=names))


def at(*angles: float) -> Poses:
    q = np.full((len(angles), LAB.dof), 0.3)
    q[:, JOINT] = angles
    return poses_of(q)


def standard_deviation(model: Model, poses: Poses) -> Array:
    """(N,), m."""
    return np.asarray(np.sqrt(np.einsum("nii->n", open_covariance(solve_equilibrium(model, poses)))))


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("cable_spring@joint2", {"c_Nm_per_rad": 0.5}),
        ("servo_gain@joint2", {"g_plus_rad_per_rad": 0.04, "g_minus_rad_per_rad": 0.04}),
    ],
)
def test_a_candidate_that_goes_on_in_proportion_may_be_all_wrong_there(effect: str, values: dict[str, float]) -> None:
    """Before: 0.8 mm were stated where a cable, which was a servo's gain, missed by 15 mm on the other side."""
    identified = upper_half(effect, **values)
    poses = at(-0.8, -0.4, 0.8)
    without = identified.with_values_of([*identified.free[: len(values)]], [0.0] * len(values))
    apart = solve_equilibrium(identified, poses).tcp - solve_equilibrium(without, poses).tcp
    found = standard_deviation(candidate(identified, effect), poses)
    np.testing.assert_allclose(found[:2], np.linalg.norm(apart[:2], axis=1), rtol=0.05)
    assert found[2] == pytest.approx(0.0, abs=1e-9)
    assert not standard_deviation(identified, poses).any()


def test_an_arm_that_does_not_settle_without_a_candidate_has_no_known_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before: `NoEquilibrium` of the law's alternative refused a goal that was solved."""

    def does_not_settle(_: Equilibrium) -> Iterator[Array]:
        raise NoEquilibrium([1], "gives way")
        yield

    settled = solve_equilibrium(upper_half("backlash@joint2"), poses_of(np.zeros((1, LAB.dof))))
    assert position_uncertainty(settled, None, [1e-3] * LAB.dof) is not None
    monkeypatch.setattr(uncertainty, "beyond_range", does_not_settle)
    assert position_uncertainty(settled, None, [1e-3] * LAB.dof) is None


def test_two_candidates_count_each() -> None:
    """Laws against each other: their sum is near zero, and one may be wrong without the other."""
    names = ("cable_spring@joint2", "servo_gain@joint2")
    alone = [candidate(upper_half(names[0], c_Nm_per_rad=0.5), names[0])]
    k = 0.5 * 0.05
    alone.append(candidate(upper_half(names[1], g_plus_rad_per_rad=k, g_minus_rad_per_rad=k), names[1]))
    both = model_of(
        LAB,
        [*alone[0].effects, *(one for one in alone[1].effects if one.name == names[1])],
        {key: model.value(key) for model in alone for key in model.keys},
    )
    both = candidate(replace(both, free=(*alone[0].free, *alone[1].free), within=alone[0].within), *names)
    poses = at(-0.8)
    variances = [standard_deviation(model, poses)[0] ** 2 for model in (both, *alone)]
    assert variances[0] == pytest.approx(sum(variances[1:]), rel=0.05)


def test_nothing_is_asked_where_the_range_is_not_known_or_not_left() -> None:
    model = candidate(upper_half("cable_spring@joint2", c_Nm_per_rad=0.5), "cable_spring@joint2")
    assert not [*beyond_range(solve_equilibrium(model, at(0.1, 0.9)))]
    assert not [*beyond_range(solve_equilibrium(replace(model, within=None), at(-0.8)))]


def test_candidates_go_into_the_file_and_back_and_an_unknown_one_is_refused() -> None:
    plain = upper_half("cable_spring@joint2", c_Nm_per_rad=0.5)
    model = candidate(plain, "cable_spring@joint2")
    assert as_written(model, "lrm-lab").candidates == ("cable_spring@joint2",)
    assert as_written(plain, "lrm-lab").candidates == ()
    table = range_table(model)
    assert table is not None
    names = [effect.name for effect in model.effects]
    for wrong in ("cable_spring@joint3", "no such"):
        spoiled = table.model_copy(update={"candidates": [wrong]})
        file = ModelFile(
            schema="lrm/model/1", arm="lrm-lab", effects=names, parameters=parameter_tables(model), range=spoiled
        )
        with pytest.raises(FileError, match=f"range.candidates: unknown effect of this model '{wrong}'"):
            to_model(Path("m.toml"), file, LAB)
