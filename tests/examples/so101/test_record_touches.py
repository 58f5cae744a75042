"""`lrm-ident sockets record` with bare servos, the simulated bus at a pty: limp, and read at each Enter."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from examples.so101.launch import simulated_so101
from tests.support.commands import run_command

pytestmark = pytest.mark.long


def test_touches_are_recorded_with_how_the_servos_are_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two touches, and the command again for a third."""
    table = tmp_path / "touches.csv"
    with simulated_so101(tmp_path, "gain", 1) as link:
        for answers in (["", "", "end"], ["", "end"]):
            told = iter(answers)
            monkeypatch.setattr("builtins.input", lambda _, told=told: next(told))
            words = ("sockets", "record", "-o", table, "--robot", f"feetech:{link}", "--points", "a,b")
            code, said, complaint = run_command(*words)
            assert (code, complaint) == (0, ""), complaint
    assert "1 touches recorded; 3 are in" in " ".join(said.split())
    rows = [line.split(",") for line in table.read_text().splitlines()]
    assert [row[-2] for row in rows[1:]] == ["a", "b", "a"]
    about = tomllib.loads(table.with_suffix(".toml").read_text())
    assert about["servos"]["elbow_flex"]["p"] > 0
