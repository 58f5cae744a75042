"""Every limit by which a residual is grouped, tested and said to follow something: a case on either side of it."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.polynomial.legendre import legval

from lrm_ident.data.error_stats import ErrorStats
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.residual import (
    data_audit,
    error_breakdown,
    free_functions,
    gaussian_process,
    predictability,
    regime,
    residual_structure,
)
from lrm_ident.residual.covariates import Covariate, distinct
from lrm_ident.residual.deployment import (
    carried_states,
    forecast_error,
    reverting_terms,
    rolling_origin,
    unmeasured_angles,
)
from lrm_ident.residual.influential_poses import influential_poses
from lrm_ident.residual.rounded_commands import RoundedCommands
from lrm_ident.residual.scale_uncertainty import scale_uncertainty
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects.base import Excitation
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.derivatives import joint_jacobian
from lrm_math.model.equilibrium import solve_equilibrium

MANY = 400
Patch = pytest.MonkeyPatch
Decision = Callable[[float, Patch], bool]
ALTERNATING = np.where(np.arange(MANY) % 2, 1.0, -1.0)
SLOW = np.where(np.arange(MANY) // 2 % 2, 1.0, -1.0)
"""(N,), uncorrelated with the other."""


def correlated(correlation: float) -> Array:
    return correlation * ALTERNATING + np.sqrt(1.0 - correlation**2) * SLOW


def repeats_another(correlation: float, _: Patch) -> bool:
    return len(distinct({"one": ALTERNATING, "other": correlated(correlation)})) == 1  # type: ignore[dict-item]


def loaded(share: float, _: Patch) -> bool:
    """A joint with a torque of one sign, beside one whose torque has both."""
    torque = np.stack([ALTERNATING, np.full(MANY, share)], axis=1)
    return bool(list(data_audit._signs(Excitation(poses_of(np.zeros((MANY, 2))), torque))))


def later_poses(count: int, patch: Patch) -> int:
    """How many of so many poses are predicted from the others to choose what is carried forward; 0: nothing is."""
    parts: list[int] = []
    patch.setattr(carried_states, "joints_of_order", lambda _: {})
    patch.setattr(carried_states, "_predicting_better", lambda *found: parts.append(len(found[2])) or {})
    for name in ("state_after_session", "replace"):
        patch.setattr(carried_states, name, lambda *_, **__: None)
    patch.setattr(carried_states, "_following", lambda *_: ())
    law = SimpleNamespace(name="drift@joint1", is_free_form=False)
    patch.setattr(carried_states, "passing_effects", lambda _: (law,))
    data: Any = SomePoses(count)
    model: Any = SimpleNamespace(with_state=lambda _: None)
    fitted: Any = SimpleNamespace(model=model, equilibrium=None)
    carried_states.with_carried_states(fitted, data)
    return sum(parts)


class SomePoses:
    """So many poses in their order."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.poses = SimpleNamespace(number=np.arange(count), q=np.zeros((count, 1)))

    def __len__(self) -> int:
        return self.count

    def take(self, rows: Array) -> SomePoses:
        return SomePoses(len(rows))


def still_as_in_the_end(off: float, _: Patch) -> bool:
    """A pose at which an effect is off its end by a part of its range."""
    effect = SimpleNamespace(name="slip@joint1")
    bound = SimpleNamespace(effect=effect, loads=(), at=lambda *_: (np.array([1.0, off, 0.0]),))
    state = SimpleNamespace(warming=(), memory=(), carried={"slip@joint1": "last"})
    model: Any = SimpleNamespace(state=state, binding=SimpleNamespace(bound=(bound,)))
    return 1 in carried_states.rows_as_deployed(model, poses_of(np.zeros((3, 1))))


def forecasts_begin(poses: int) -> list[int]:
    return rolling_origin._edges(range(poses))  # type: ignore[arg-type]


def same_forecasts(off: float, _: Patch) -> bool:
    return rolling_origin.same_forecasts(np.ones(9), np.ones(9) - off)


def kept_as_one(degrees: float, _: Patch) -> bool:
    return len(unmeasured_angles._distinct(np.radians([0.0, degrees]))) == 1


def one_level(degrees: float, _: Patch) -> bool:
    return len({*unmeasured_angles._levels(np.radians([0.0, degrees]))}) == 1


def hold_most_of_the_error(share: float, _: Patch) -> bool:
    """One of many poses, predicted badly without it."""
    held_out = np.zeros((MANY, 3))
    held_out[:, 0] = np.sqrt(1.0 - share)
    held_out[7, 0] = np.sqrt(share * (MANY - 1))
    return influential_poses(np.zeros((MANY, 3)), held_out) is not None


def may_be_rounding(ratio: float, _: Patch) -> bool:
    found = [RoundedCommands(0.01, 1.0).explains(float(np.hypot(size, 0.1)), 0.1) for size in (ratio, 1.0 / ratio)]
    assert found[0] is found[1]
    return found[0]


def decided_by_a_length(share: float, _: Patch) -> bool:
    """A scale that owes this share of its variance to the lengths."""
    keys = ("measurement_frame.frame.scale_x_per_m", "offsets.joint2.a_mm")
    covariance = np.array([[1.0, np.sqrt(share)], [np.sqrt(share), 1.0]])
    fitted: Any = SimpleNamespace(
        model=SimpleNamespace(effects=(), free=keys), covariance=covariance, residual=np.zeros((2, 3)),
        equilibrium=SimpleNamespace(true_tcp=np.zeros((2, 3))),
    )  # fmt: skip
    return scale_uncertainty(fitted) is not None


def grouped_by_value(values: float, _: Patch) -> bool:
    return "to" not in error_breakdown._by_value(np.arange(MANY) % values, "°")[1][0]


def part_of_its_own(values: float, _: Patch) -> bool:
    """Of a quantity, each value."""
    return len({*regime._parts(Covariate("load", np.arange(MANY) % values / 1e3))}) == values


def loads_are_one(kg: float, patch: Patch) -> bool:
    """A later load beyond the earlier ones."""
    asked: list[str] = []

    def predicted(*_: Any) -> None:
        asked.append("fit")
        raise forecast_error.LrmError("enough")

    data: Any = SomePoses(MANY)
    data.tcp, data.poses.payload = np.zeros((MANY, 3)), np.where(np.arange(MANY) == MANY - 1, kg, 0.0)
    data.take = lambda _: data
    data.borne_by = lambda _: data
    for name, answer in {"_origin": MANY - 50, "field_of": None, "allows_rolling_origin": True}.items():
        patch.setattr(forecast_error, name, lambda *_, answer=answer: answer)
    patch.setattr(forecast_error, "_predicted", predicted)
    forecast_error.forecast_error(SimpleNamespace(free=("a",)), data, None, None)  # type: ignore[arg-type]
    return bool(asked)


def surely_worse(z: float, patch: Patch) -> bool:
    """Later poses, by the standard errors by which those before predict them worse than all around do."""
    data: Any = SomePoses(MANY)
    data.tcp, data.poses.payload = np.zeros((MANY, 3)), np.zeros(MANY)
    data.take = lambda _: data
    data.borne_by = lambda _: data
    predicted = SimpleNamespace(
        sigma=1.0, followed=np.ones((50, 3)), unknown=np.ones((50, 3)), squares=lambda *_: np.ones(MANY)
    )
    for name, answer in {
        "_origin": MANY - 50, "field_of": None, "allows_rolling_origin": True, "_predicted": predicted, "paired_z": z,
    }.items():  # fmt: skip
        patch.setattr(forecast_error, name, lambda *_, answer=answer: answer)
    found = forecast_error.forecast_error(SimpleNamespace(free=("a",)), data, None, None)  # type: ignore[arg-type]
    return any(isinstance(value, ErrorStats) for value in vars(found).values())


def ends_with_the_range(patch: Patch, size: float, inflation: float = 1.0) -> bool:
    """A term that is so large at the joint's limit, over its size in the measured range; of its change with the angle
    other parameters explain so much."""
    angle = np.linspace(-1.0, 1.0, MANY)
    motion = np.zeros((MANY, 3))
    motion[:, 0] = 1.0
    patch.setattr(reverting_terms, "parameter_jacobian", lambda *_: motion[:, :, None])
    patch.setattr(reverting_terms, "_only", lambda *_: np.ones(1))
    patch.setattr(reverting_terms, "_beside", lambda _, column: column / np.sqrt(inflation))
    joint = SimpleNamespace(lower=-3.0, upper=3.0)
    model = SimpleNamespace(
        free=("a",), arm=SimpleNamespace(dof=1, joints=(joint,)), within=SimpleNamespace(angle=((-1.0, 1.0),))
    )
    fitted: Any = SimpleNamespace(
        model=model, sigma=0.0, residual=motion * angle[:, None] * (size - 1.0) / 3.0,
        equilibrium=SimpleNamespace(poses=SimpleNamespace(q=angle[:, None])),
    )  # fmt: skip
    term: Any = SimpleNamespace(keys=("a",))
    return bool(np.isfinite(reverting_terms._ends(fitted, term)).any())


def smaller_at_the_limit(size: float, patch: Patch) -> bool:
    return ends_with_the_range(patch, size)


def told_from_the_other_parameters(inflation: float, patch: Patch) -> bool:
    return ends_with_the_range(patch, 0.0, inflation)


GATES: dict[Decision, tuple[float, float]] = {
    repeats_another: (0.998, 0.9995),
    loaded: (0.045, 0.055),
    still_as_in_the_end: (0.11, 0.09),
    same_forecasts: (1.1e-3, 0.9e-3),
    kept_as_one: (2.6, 2.4),
    one_level: (5.5, 4.5),
    hold_most_of_the_error: (0.45, 0.55),
    may_be_rounding: (1.6, 1.4),
    decided_by_a_length: (0.45, 0.55),
    grouped_by_value: (9, 8),
    part_of_its_own: (11, 10),
    loads_are_one: (1.1e-3, 0.9e-3),
    surely_worse: (3.0, 3.2),
    smaller_at_the_limit: (0.55, 0.45),
    told_from_the_other_parameters: (110.0, 90.0),
}
"""By decision: a figure for which it is no, and one for which it is yes."""


@pytest.mark.parametrize(("decision", "figures"), GATES.items(), ids=lambda one: getattr(one, "__name__", ""))
def test_a_limit_stands_where_it_is_stated(decision: Decision, figures: tuple[float, float]) -> None:
    for figure, right in zip(figures, (False, True), strict=True):
        with pytest.MonkeyPatch.context() as patch:
            assert decision(figure, patch) is right


@pytest.mark.parametrize(("poses", "later"), [(19, 0), (20, 10), (60, 10), (200, 20)])
def test_the_last_tenth_of_the_poses_chooses_what_is_carried(poses: int, later: int, monkeypatch: Patch) -> None:
    """Ten at least, and of the others as many."""
    assert later_poses(poses, monkeypatch) == later


def test_forecasts_begin_at_three_quarters_and_half_way_to_the_end() -> None:
    assert forecasts_begin(80) == [60, 70, 80]


def test_angles_of_more_values_are_grouped_in_six_bins_and_the_order_in_tenths() -> None:
    assert len(error_breakdown._by_value(np.linspace(0.0, 1.0, MANY), "°")[1]) == 6
    data: Any = SimpleNamespace(pose=np.arange(MANY), __len__=None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(error_breakdown, "len", lambda of: MANY if of is data else len(of), raising=False)
        assert len(error_breakdown._by_order(data)[1]) == 10


def test_regimes_are_tried_on_25_halvings_and_tenths_of_the_poses() -> None:
    halves = regime._halves(np.arange(MANY))
    assert [len(halves), *{int(half.sum()) for half in halves}] == [25, MANY // 2]
    assert np.bincount(regime._parts(Covariate("load", np.linspace(0.0, 1.0, MANY)))).tolist() == [MANY // 10] * 10


def test_structure_is_that_of_six_neighbours_beside_400_draws_of_noise(monkeypatch: Patch) -> None:
    rng, drawn = np.random.default_rng(0), list[int]()
    q, residual = rng.uniform(-1.0, 1.0, (60, 3)), rng.normal(size=180)
    pairs = residual_structure.neighbours(q)
    apart = np.linalg.norm(q[:, None] - q, axis=2)
    np.fill_diagonal(apart, np.inf)
    near = {(i, j) for i, row in enumerate(np.argsort(apart, axis=1)[:, :6].tolist()) for j in row}
    assert {*map(tuple, pairs.tolist())} == near
    whole = residual_structure._morans_i
    monkeypatch.setattr(
        residual_structure, "_morans_i", lambda of, *rest: drawn.append(of.shape[1]) or whole(of, *rest)
    )
    residual_structure.residual_structure(q, residual, np.zeros((180, 1)))
    assert {*drawn} == {1, 400}


def test_free_functions_have_six_degrees_products_fewer_than_five_together() -> None:
    """Legendre polynomials, and each product of two whose degrees add up to six at most."""
    x, y = (Covariate("angle", np.random.default_rng(seed).uniform(-1.0, 1.0, 30), seed) for seed in (0, 1))
    scaled = [free_functions.scaled(each.values) for each in (x, y)]
    products = free_functions._products(x, y)
    wanted = [
        legval(scaled[0], np.eye(7)[i]) * legval(scaled[1], np.eye(7)[j])
        for i in range(1, 6) for j in range(1, 6) if i + j <= 6
    ]  # fmt: skip
    assert products is not None
    np.testing.assert_allclose(products.T, wanted, atol=1e-12)
    assert free_functions.lagged(np.zeros((30, 2))).shape == (30, 12, 2)


def followed(relevance: Array, patch: Patch, rows: int = 20) -> tuple[int, int]:
    """How many of some inputs are said to be followed, and how many rows a kernel is estimated from."""
    estimated: list[int] = []
    kernel = SimpleNamespace(signal=1.0, lengths=1.0 / np.sqrt(relevance))
    patch.setattr(gaussian_process, "fit_kernel", lambda _, y: estimated.append(len(y)) or kernel)
    patch.setattr(gaussian_process, "condition", lambda *_: SimpleNamespace(mean=lambda x: np.zeros(len(x))))
    patch.setattr(gaussian_process.FactoredKernel, "of", lambda *_: None)
    data: Any = SimpleNamespace(tcp=np.zeros((rows, 3)))
    names = {str(number): np.zeros(rows) for number in range(len(relevance))}
    patch.setattr(predictability, "pose_covariates", lambda *_: names)
    patch.setattr(predictability, "held_out_residual", lambda _: np.zeros((rows, 3)))
    block: Any = SimpleNamespace(
        train=np.arange(rows), test=np.arange(1), train_residual=np.ones((rows, 3)), test_residual=np.ones((1, 3))
    )
    return len(predictability.predictable_error(data, [block]).follows), estimated[0]


def test_inputs_that_matter_are_named_five_at_most(monkeypatch: Patch) -> None:
    """Each matters a tenth as much as the first, or more; kernels are estimated from 250 rows."""
    assert followed(np.array([1.0, 0.11, 0.09]), monkeypatch) == (2, 20)
    assert followed(np.ones(9), monkeypatch, rows=600) == (5, 250)


def test_forecasts_are_of_a_thousand_poses_at_most() -> None:
    taken: list[int] = []

    class Enough(Exception):
        """Raised as soon as they are taken."""

    def take(rows: Array) -> None:
        taken.append(len(rows))
        raise Enough

    data: Any = SomePoses(5000)
    data.take = take
    with pytest.raises(Enough):
        forecast_error.forecast_error(None, data, None, None)  # type: ignore[arg-type]
    assert taken == [1000]


def test_ten_worst_poses_and_functions_of_six_degrees() -> None:
    """Of one quantity with many values."""
    arm = load_arm("lrm-lab")
    model = nominal_model(arm)
    poses = poses_of(np.random.default_rng(0).uniform(-1.0, 1.0, (40, arm.dof)))
    settled = solve_equilibrium(model, poses)
    data = Measurements.of_tcp(poses, settled.tcp + np.linspace(0.0, 1e-3, 40)[:, None])
    compared = error_breakdown._compared(model, data, error_breakdown.HeldOutResidual(None, "few"))
    assert compared.worst == tuple(range(39, 29, -1))
    before = free_functions.lagged(settled.joint_torque)
    J = joint_jacobian(settled).transpose(2, 1, 0)
    single = [one for one in free_functions.free_functions(J, data, settled, before) if len(one.covariates) == 1]
    assert {one.size for one in single if one.place == 1 and one.covariates[0].kind == "angle"} == {6}
