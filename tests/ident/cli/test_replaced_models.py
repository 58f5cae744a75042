"""A model of several steps is not replaced by one of fewer without being told."""

from __future__ import annotations

from pathlib import Path

from tests.conftest import EXAMPLE
from tests.support.commands import stderr_of, stdout_of


def test_a_fit_does_not_replace_the_result_of_added_effects(tmp_path: Path) -> None:
    best, fitted = tmp_path / "best.toml", tmp_path / "model.toml"
    stdout_of("fit", EXAMPLE, "-o", fitted)
    stdout_of("fit", EXAMPLE, "-o", fitted)  # one of as many steps
    stdout_of("add", fitted, EXAMPLE, "backlash@joint2", "-o", best)
    kept = best.read_bytes()
    assert "--force" in stderr_of("fit", EXAMPLE, "-o", best)
    assert "2 steps" in stderr_of("auto", fitted, EXAMPLE, "-o", best)
    assert best.read_bytes() == kept
    stdout_of("fit", EXAMPLE, "-o", best, "--force")
    assert best.read_bytes() != kept
