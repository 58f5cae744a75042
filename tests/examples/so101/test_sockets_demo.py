"""Touched sockets alone name the play that is hidden, and calibrate about as well as a tracker."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from examples.so101.sockets_demo import main

RATIO = 1.5
"""Of the tip's error by sockets over that by a tracker of the same noise at the same poses."""


@pytest.mark.slow
def test_sockets_name_the_hidden_play_and_calibrate_as_a_tracker(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--seed", "3", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "backlash@joint3" in said
    found = re.findall(r"(as drawn|by sockets|by a tracker) +([\d.]+) mm", said)
    errors = {words: float(error) for words, error in found}
    assert errors["by sockets"] < RATIO * errors["by a tracker"] < 0.3 * errors["as drawn"]
