"""A file that has grown since the fit is still the data of the fit; one whose rows changed is another."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lrm_ident.study import other_data
from lrm_ident.study.other_data import model_for_data

FITTED = b"q1,x\n1,2\n"


@pytest.mark.parametrize(("now", "whole"), [(FITTED + b"3,4\n", True), (b"q1,x\n1,5\n3,4\n", False)])
def test_the_model_is_whole_on_its_data_with_rows_added(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, now: bytes, whole: bool
) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(now)
    model: Any = SimpleNamespace(effects=(SimpleNamespace(name="drift@joint1"),), fitted_to=sha256(FITTED).hexdigest())
    deployed = SimpleNamespace(effects=())
    monkeypatch.setattr(other_data, "of_a_session", lambda _: True)
    monkeypatch.setattr(other_data, "as_deployed", lambda _: deployed)
    found, said = model_for_data(model, path, sha256(now).hexdigest())
    assert (found is model) is whole
    assert bool(said) is not whole
