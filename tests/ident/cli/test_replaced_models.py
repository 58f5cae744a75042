"""A model of several steps is not replaced by one of fewer without being told."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.conftest import EXAMPLE
from tests.support.commands import stderr_of, stdout_of

pytestmark = pytest.mark.long


def test_a_fit_does_not_replace_the_result_of_added_effects(tmp_path: Path, example_model: Path) -> None:
    best, fitted = tmp_path / "best.toml", Path(shutil.copy(example_model, tmp_path / "model.toml"))
    stdout_of("fit", EXAMPLE, "--parameters", "option3", "-o", fitted)  # one of as many steps
    stdout_of("add", example_model, EXAMPLE, "backlash@joint2", "-o", best)
    kept = best.read_bytes()
    assert "--force" in stderr_of("fit", EXAMPLE, "-o", best)
    assert "2 steps" in stderr_of("auto", example_model, EXAMPLE, "-o", best)
    assert best.read_bytes() == kept
    stdout_of("fit", EXAMPLE, "--parameters", "option3", "-o", best, "--force")
    assert best.read_bytes() != kept
