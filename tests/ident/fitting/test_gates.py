"""Every limit at which a fit takes, leaves out, lists or repeats something: a case on either side of it, near enough
that a change by a quarter would decide it anew."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lrm_ident.fitting import cross_validation, identifiability, model_fit
from lrm_ident.fitting.cross_validation import Split, held_out_blocks, joint_space_folds
from lrm_ident.fitting.dependence import explain_dependence
from lrm_ident.fitting.identifiability import selection_order
from lrm_ident.fitting.loss import Cauchy, Huber, Loss, robust_scale
from lrm_ident.fitting.prior_conflict import unusual_dimensions
from lrm_ident.fitting.priors import weak_prior
from lrm_ident.fitting.typical_prior import typical_prior
from lrm_ident.residual.influential_poses import influential_poses
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError

MANY = 200
Patch = pytest.MonkeyPatch
Decision = Callable[[float, Patch], bool]


def worth_fitting(t: float, _: Patch) -> bool:
    """Of a typical size over its standard error."""
    return identifiability._gram_schmidt(np.array([[t], [0.0]]), 1.0)[0] == [0]


def turned_before_the_tool_is_moved(lever: float, patch: Patch) -> bool:
    """The last joint's zero offset, by the distance (m) of the tip from its axis."""
    patch.setattr(identifiability, "_last_lever", lambda _: lever)
    model = model_fit.nominal_model(load_arm("lrm-lab"))
    first, *_ = selection_order(model, ["offsets.joint6.theta_rad", "offsets.tool.x_mm"])
    return first == "offsets.joint6.theta_rad"


def listed_in_a_combination(share: float, _: Patch) -> bool:
    """A parameter whose motion is a part of that of the one that is held."""
    columns = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, share]])
    model: Any = SimpleNamespace(parameter=lambda _: SimpleNamespace(si=1.0))
    held = explain_dependence(columns, np.ones(3), ["a", "b", "c"], model, (0, 1), 2, 0.0, 1.0)
    return "b" in dict(held.combination)


def fits_every_fold_anew(poses: float, patch: Patch) -> bool:
    fitted: list[str] = []
    for name in ("_refitted", "one_step_fits"):
        patch.setattr(cross_validation, name, lambda *_, name=name: fitted.append(name))
    for name in ("_splits", "_blocks", "_check_enough", "fit", "field_of"):
        patch.setattr(cross_validation, name, lambda *_: None)
    data: Any = SimpleNamespace(borne_by=lambda _: data)
    patch.setattr(cross_validation, "len", lambda of: int(poses) if of is data else len(of), raising=False)
    held_out_blocks(SimpleNamespace(free=("a",)), data)  # type: ignore[arg-type]
    return fitted == ["_refitted"]


def told(value: float, share: float) -> bool:
    """Whether a dimension is said to be unusual: its size in typical ones, the share of its prior that was told."""
    key = "offsets.joint2.a_mm"
    model = SimpleNamespace(free=(key,), value=lambda _: value, parameter=lambda _: SimpleNamespace(typical=1.0))
    return unusual_dimensions(SimpleNamespace(model=model, told=[share])) == (key,)  # type: ignore[arg-type]


def unusual(sizes: float, _: Patch) -> bool:
    return told(sizes, 1.0)


def determined(share: float, _: Patch) -> bool:
    return told(10.0, share)


def fitted(patch: Patch, told: float = 1.0, growth: float = 1.0, outliers: int = 0) -> tuple[int, str]:
    """How often a model is fitted, and what is said where nothing could be."""
    fits: list[str] = []
    model = SimpleNamespace(free=("a",))
    fit = SimpleNamespace(
        model=model, equilibrium=None, effective_parameters=1.0, at_bound=(), told=np.array([told]),
        outliers=tuple(range(outliers)), residual=np.ones((MANY, 3)),
    )  # fmt: skip

    def data(error: float) -> Any:
        return SimpleNamespace(positions=SimpleNamespace(model_sd=error), pose=np.arange(MANY), __len__=None)

    grown = [growth, 1.0]
    patch.setattr(model_fit, "with_set_up", lambda model, _: model)
    patch.setattr(model_fit, "_fit_named", lambda *_: fits.append("fit") or SimpleNamespace(fit=fit))
    patch.setattr(
        model_fit, "with_model_error", lambda of, *_: data(of.positions.model_sd * (grown.pop(0) if grown else 1.0))
    )
    patch.setattr(model_fit, "len", lambda of: MANY if isinstance(of, SimpleNamespace) else len(of), raising=False)
    try:
        model_fit.fit_model(model, data(1.0), "all", None)  # type: ignore[arg-type]
    except LrmError as error:
        return len(fits), str(error)
    return len(fits), ""


def repeated_with_model_error(growth: float, patch: Patch) -> bool:
    return fitted(patch, growth=growth)[0] == 2


def something_fitted(share: float, patch: Patch) -> bool:
    return not fitted(patch, told=share)[1]


def so_few_that_they_are_listed(share: float, patch: Patch) -> bool:
    return "--leave-out" in fitted(patch, 0.0, outliers=round(share * MANY))[1]


def left_out_as_an_outlier(distance: float, _: Patch) -> bool:
    """By robust standard deviations per axis: a pose that is far from its prediction without it, and near with it."""
    held_out = np.ones((8, 3)) / np.sqrt(3.0)
    held_out[0] *= distance * robust_scale(np.ones(8))
    return influential_poses(np.zeros((8, 3)), held_out) is not None


def counts_less(distance: float, _: Patch, loss: Loss) -> bool:
    """To Huber's loss, less than a near pose; to Cauchy's, less than half as much."""
    return bool(loss.weight(np.array([distance]))[0] < (1.0 if loss.name == "huber" else 0.5))


GATES: dict[Decision, tuple[float, float]] = {
    worth_fitting: (2.8, 3.2),
    turned_before_the_tool_is_moved: (0.045, 0.055),
    listed_in_a_combination: (0.045, 0.055),
    fits_every_fold_anew: (201, 200),
    unusual: (2.8, 3.2),
    determined: (0.45, 0.55),
    repeated_with_model_error: (1.08, 1.12),
    something_fitted: (0.045, 0.055),
    so_few_that_they_are_listed: (0.21, 0.19),
    left_out_as_an_outlier: (4.8, 5.2),
    partial(counts_less, loss=Huber()): (2.4, 2.6),
    partial(counts_less, loss=Cauchy()): (3.4, 3.6),
}
"""By decision: a figure for which it is no, and one for which it is yes."""


@pytest.mark.parametrize(("decision", "figures"), GATES.items(), ids=lambda one: getattr(one, "__name__", None))
def test_a_limit_stands_where_it_is_stated(decision: Decision, figures: tuple[float, float]) -> None:
    for figure, right in zip(figures, (False, True), strict=True):
        with pytest.MonkeyPatch.context() as patch:
            assert decision(figure, patch) is right


def test_outliers_that_are_few_are_listed_as_far_as_eight(monkeypatch: Patch) -> None:
    assert "0, 1, 2, 3, 4, 5, 6, 7 and 3 more" in fitted(monkeypatch, 0.0, outliers=11)[1]


def test_of_many_training_rows_a_thousand_are_predicted() -> None:
    """Evenly spread, beside the rows that are left out."""
    fold = np.zeros(5000, dtype=np.int64)
    fold[100:600] = 1
    split = cross_validation._splits([None] * 5000, fold)[1]  # type: ignore[arg-type]
    training = np.setdiff1d(split.predicted, split.test)
    assert split.test.tolist() == [*range(100, 600)]
    assert len(training) == 1000
    apart = np.diff(np.setdiff1d(np.arange(5000), split.test).searchsorted(training))
    assert np.ptp(apart) <= 1
    assert len(Split.of(split.test, 700, 1000).predicted) == 700


def test_poses_are_left_out_in_ten_parts() -> None:
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (95, 3))
    assert np.bincount(joint_space_folds(q, np.arange(95))).tolist().count(0) == 0
    assert joint_space_folds(q, np.arange(95)).max() == 9


def test_a_vague_prior_is_three_typical_sizes_wide() -> None:
    model = model_fit.nominal_model(load_arm("lrm-lab"))
    model = model.with_free(model.keys)
    typical = np.array([parameter.typical for parameter in model.parameters])
    np.testing.assert_allclose(weak_prior(model).sd_of(model.free), 3.0 * typical)


def test_an_effect_is_expected_within_three_typical_sizes() -> None:
    """A Cauchy distribution: heavy tails, hundred times as wide at first; where the base stands is known to 5 cm."""
    model = model_fit.nominal_model(load_arm("lrm-lab"), ("offsets", "backlash@joint2"))
    model = model.with_free([key for key in model.keys if model.parameter(key).fixed is None])
    prior = typical_prior(model)
    by_key = dict(zip(prior.keys, zip(prior.tail, np.sqrt(np.diag(prior.covariance)), strict=True), strict=True))
    play = 3.0 * model.parameter("backlash.joint2.b_rad").typical
    assert by_key["backlash.joint2.b_rad"] == pytest.approx((play, 100.0 * play))
    assert by_key["offsets.base.x_mm"] == pytest.approx((0.0, 0.05))
    assert by_key["offsets.base.alpha_rad"] == pytest.approx((0.0, 0.2))


def test_the_scale_of_gaussian_distances_is_their_standard_deviation() -> None:
    """Of three axes, and of one where only a length was read."""
    noise = np.random.default_rng(0).normal(size=(40_000, 3))
    assert robust_scale(np.linalg.norm(noise, axis=1)) == pytest.approx(1.0, rel=0.02)
    assert robust_scale(np.abs(noise[:, 0]), 1.0) == pytest.approx(1.0, rel=0.02)
