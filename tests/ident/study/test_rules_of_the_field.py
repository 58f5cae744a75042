"""When a residual field is added: by its prediction in random folds and beside the poses, without a fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lrm_ident.diagnosis.step import Step
from lrm_ident.study import field_step
from lrm_ident.study.field_step import NoBetterPrediction
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.model.step_name import ADD

Patch = pytest.MonkeyPatch


def residual(rms: float) -> Array:
    """(N, 3), of this RMS, with a scatter that is small beside it."""
    return np.outer(rms * (1.0 + 0.01 * (-1.0) ** np.arange(200)), [1.0, 0.0, 0.0])


def taken(patch: Patch, arm: Arm, among: float, beside: float) -> Step:
    """The step of a field that leaves so much of an error of 1 mm among the poses (random folds), and beside them."""
    data: Any = SimpleNamespace(poses=SimpleNamespace(q=None), repeat_of=None)
    after = {"random": residual(among), "blocks": residual(beside)}
    patch.setattr(field_step, "check_positions", lambda _: None)
    patch.setattr(field_step, "random_folds", lambda *_: "random")
    patch.setattr(field_step, "held_out_blocks", lambda *_, fold, **__: (fold or "blocks", residual(1.0)))
    patch.setattr(field_step, "blocks_with_field", lambda _, __, without: (without[0], after[without[0]]))
    patch.setattr(field_step, "held_out_residual", lambda blocks: blocks[1])
    patch.setattr(field_step, "fit", lambda *_, **__: None)
    patch.setattr(field_step, "fit_with_field", lambda *_: SimpleNamespace(model=None))
    patch.setattr(field_step.HeldOutResidual, "of", lambda *_: None)
    model: Any = SimpleNamespace(arm=arm)
    return field_step.field_step(model, data, None, None, lambda *_: None)  # type: ignore[arg-type]


@pytest.mark.parametrize(("among", "beside"), [(0.93, 1.0), (0.93, 1.015), (0.5, 0.5)])
def test_a_field_is_added_where_it_predicts_better_among_the_poses(
    lab: Arm, monkeypatch: Patch, among: float, beside: float
) -> None:
    assert taken(monkeypatch, lab, among, beside).name == (ADD, "residual_field@tool")


def test_none_is_added_where_it_saves_little_among_the_poses(lab: Arm, monkeypatch: Patch) -> None:
    with pytest.raises(NoBetterPrediction, match="does not surely predict better"):
        taken(monkeypatch, lab, 0.97, 1.0)


def test_none_is_added_where_it_does_harm_beside_the_poses(lab: Arm, monkeypatch: Patch) -> None:
    with pytest.raises(NoBetterPrediction, match="beside the poses it predicts worse"):
        taken(monkeypatch, lab, 0.5, 1.05)
