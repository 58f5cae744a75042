"""Nested cross-validation of `auto`: what it is judged at."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lrm_ident.diagnosis import nested_cross_validation
from lrm_ident.fitting.executors import in_this_process
from tests.support.misreadings import random_arm_data

FAR = 19e-3


def predicted(model: Any, data: Any, *arguments: Any) -> Any:
    *_, out = arguments
    residual = np.full((int(out.sum()), 3), 1e-3)
    residual[data.pose[out] == 7] = FAR
    return nested_cross_validation._Fold(model, residual, residual, ())


def test_it_is_judged_where_auto_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before: 5.44 mm nested beside 0.55 mm held out, as only the latter was without 13 outliers."""
    data = random_arm_data("ur5", 1, poses=40)
    monkeypatch.setattr(nested_cross_validation, "_predict", predicted)
    monkeypatch.setattr(nested_cross_validation, "rows_as_deployed", lambda _, poses: np.arange(len(poses)))
    model: Any = None
    with in_this_process() as executor:
        every, without = (
            nested_cross_validation.nested_held_out(model, data, executor, left_out=left_out) for left_out in ((), (7,))
        )
    assert every.error is not None
    assert without.error is not None
    assert without.deployed is not None
    assert every.error.max == pytest.approx(np.sqrt(3.0) * FAR)
    assert without.error.max == pytest.approx(np.sqrt(3.0) * 1e-3)
    assert without.deployed.now.max == pytest.approx(np.sqrt(3.0) * 1e-3)
