"""`make demo ARM=so101` in a short form: it ends by itself, and the tip lands nearer with every step."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from examples.so101.demo import main, run_demo
from examples.so101.hidden_arm import HIDDEN, NAMED
from lrm_math.effects import ALL_EFFECTS


@pytest.mark.slow
def test_the_story_ends_nearer_to_its_goals(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_demo(tmp_path, 1, poses=40, goals=3)
    said, found = capsys.readouterr().out, json.loads((tmp_path / "demo.json").read_text())
    drawn, fitted, with_effect = found["rms_mm"].values()
    assert fitted < drawn
    assert with_effect < 0.2 * drawn
    assert found["hidden"] == "servo_gain@joint3"
    for command in ("measure", "verify", "fit", "diagnose", "add", "report"):
        assert f"$ lrm-ident {command}" in said
    assert (tmp_path / "report.html").exists()


def test_every_hidden_effect_has_a_name_of_the_catalogue() -> None:
    assert set(NAMED) == set(HIDDEN)
    assert {name.partition("@")[0] for name, _ in NAMED.values()} <= {effect.id for effect in ALL_EFFECTS}


def test_a_folder_that_cannot_be_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["--out", str(tmp_path / "file" / "out"), "--seed", "1"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
