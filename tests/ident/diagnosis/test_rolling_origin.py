"""An effect of a session is taken where it predicts later poses from earlier ones, and not where it only fits them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis import candidate_trial, confirm
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.residual.deployment.rolling_origin import allows_rolling_origin, changes_too_late, rolling_origin_squares
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import ModelPart, effects_at
from lrm_math.kinematics.poses import poses_of
from validation.as_deployed.worlds import SimulatedCase

Patch = pytest.MonkeyPatch


@pytest.mark.parametrize(
    ("world", "effect"),
    [
        ("catalogue/first/slip4/80/0", "change_point@joint4"),
        ("catalogue/second/creep2/report/80/0", "creep@joint2"),
    ],
)
def test_what_goes_on_predicts_later_poses(world: str, effect: str, tmp_path: Path) -> None:
    data, _ = SimulatedCase.of(world).record().load(tmp_path)
    study = Study.of(data).fit()
    assert study.step is not None
    plain = study.step.fit
    [one] = effects_at(plain.model.arm, effect)
    named = add_effects(plain.model, study.data, [one])
    assert named.sigma < plain.sigma
    assert allows_rolling_origin(study.data)
    assert len(rolling_origin_squares(named, study.data)) == len(study.data) / 4
    assert candidate_trial._not_better_later([one], plain, named, study.data) is None


def judged(patch: Patch, without: Any, with_it: Any, depends_on: str = "time", part: object = ModelPart.ARM) -> bool:
    """Whether there is an objection to an effect with these forecasts, squared errors (M,)."""
    patch.setattr(candidate_trial, "allows_rolling_origin", lambda _: True)
    patch.setattr(candidate_trial, "changes_too_late", lambda *_: False)
    patch.setattr(candidate_trial, "rolling_origin_squares", lambda fitted, _: fitted.squares)
    effect: Any = SimpleNamespace(depends_on=(depends_on,), part=part)
    fits: list[Any] = [SimpleNamespace(squares=squares, model=None) for squares in (without, with_it)]
    nothing: Any = None
    return candidate_trial._not_better_later([effect], *fits, nothing) is not None


@pytest.mark.parametrize(("step", "late"), [(24.0, False), (25.0, False), (26.0, True), (31.0, True)])
def test_a_change_needs_ten_poses_behind_it_to_be_forecast(step: float, late: bool) -> None:
    """Of 40 poses, the last five are forecast last."""
    [effect] = effects_at(load_arm("so101"), "change_point@tool")
    model: Any = SimpleNamespace(value=lambda _: step)
    poses, number = poses_of(np.zeros((40, 5))), np.arange(1, 41)
    data = Measurements(replace(poses, number=number), number, np.zeros((40, 3)), None, None, number, Path("few"), "")
    assert changes_too_late(effect, model, data) is late


def test_a_gain_within_its_spread_is_not_shown(monkeypatch: Patch) -> None:
    rng = np.random.default_rng(0)
    one, other = 1.0 + 0.3 * rng.random((2, 200))
    assert judged(monkeypatch, one, other)
    assert judged(monkeypatch, 0.8 * one, other)
    assert not judged(monkeypatch, one, 0.8 * other)


def test_what_forecasts_cannot_judge_is_left_to_the_cross_validation(monkeypatch: Patch) -> None:
    """A change after the last poses that forecasts are fitted to; what is no effect of a session; a tracker."""
    same = np.ones(200)
    assert not judged(monkeypatch, same, same * (1.0 + 1e-6))
    worse = 2.0 * same
    assert judged(monkeypatch, same, worse)
    assert not judged(monkeypatch, same, worse, depends_on="angle")
    assert not judged(monkeypatch, same, worse, part=ModelPart.MEASUREMENT)


def test_two_that_hide_each_other_are_confirmed_together(tmp_path: Path) -> None:
    """A tracker's scale and a screw that slipped: neither alone makes the deployed model surely better."""
    data, _ = SimulatedCase.of("catalogue/pair/stretched+slip2/80/0").record().load(tmp_path)
    found = confirm.confirm(Study.of(data).fit().screen())
    assert found.first is not None
    assert found.first.name == "change_point@joint2"
    assert found.beside == "measurement_frame@frame"
    assert not found.refused
