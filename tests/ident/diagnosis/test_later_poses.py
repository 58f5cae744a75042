"""An effect of a session is taken where it predicts later poses from earlier ones, and not where it only fits them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lrm_ident.diagnosis import confirm
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.residual.deployment.later_poses import later_squares, tells_of_later
from lrm_ident.study.study import Study
from lrm_math.effects import ModelPart, effects_at
from validation.as_deployed.worlds import SimulatedCase

Patch = pytest.MonkeyPatch


@pytest.mark.parametrize(
    ("world", "effect", "holds"),
    [
        ("catalogue/first/slip4/80/0", "change_point@joint4", True),
        ("catalogue/second/creep2/report/80/0", "creep@joint2", True),
        ("catalogue/second/weather2/tune/300/0", "drift@joint2", False),
    ],
)
def test_what_goes_on_is_told_from_what_only_fits(world: str, effect: str, holds: bool, tmp_path: Path) -> None:
    data, _ = SimulatedCase.of(world).record().load(tmp_path)
    study = Study.of(data).fit()
    assert study.step is not None
    plain = study.step.fit
    [one] = effects_at(plain.model.arm, effect)
    named = add_effects(plain.model, study.data, [one])
    assert named.sigma < plain.sigma
    assert tells_of_later(study.data)
    assert len(later_squares(named, study.data)) == len(study.data) / 2
    objection = confirm._not_better_later(one, plain, named, study.data)
    assert (objection is None) is holds
    if objection:
        without, with_it = objection
        assert 1e-4 < without < with_it * 1.1


def judged(patch: Patch, without: Any, with_it: Any, depends_on: str = "time", part: object = ModelPart.ARM) -> bool:
    """Whether there is an objection to an effect with these forecasts, squared errors (M,)."""
    patch.setattr(confirm, "tells_of_later", lambda _: True)
    patch.setattr(confirm, "later_squares", lambda squares, _: squares)
    effect: Any = SimpleNamespace(depends_on=(depends_on,), part=part)
    return confirm._not_better_later(effect, without, with_it, None) is not None  # type: ignore[arg-type]


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
