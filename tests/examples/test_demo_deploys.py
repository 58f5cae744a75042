"""The demo accepts every model, and prints the reason and the size where `lrm deploy` would refuse it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from examples.demo.steps import DemoSteps
from tests.daemon.cli.test_deploy_check import COVARIANCE, DRIFTING, STATE, written


@dataclass(frozen=True)
class RecordedSteps(DemoSteps):
    """Steps whose commands are kept in place of being run."""

    ran: list[list[str]] = field(default_factory=list)

    def _run(self, program: str, words: Sequence[str]) -> None:
        self.ran.append([program, *words])


@pytest.mark.parametrize(("drift", "offset", "refused"), [(1e-6, "1e-6", False), (0.05, "0.03", True)])
def test_what_is_left_out_is_shown_with_its_size(
    drift: float, offset: str, refused: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, DRIFTING.format(drift=drift) + COVARIANCE + STATE.replace("0.01", offset))
    steps = RecordedSteps(tmp_path, (), 0, "1")
    steps.deploy("model.toml", "--robot", "demo")
    assert steps.ran == [["lrm", "--robot", "demo", "deploy", str(path), "--accept"]]
    shown = " ".join(capsys.readouterr().out.split())
    assert ("refuses this model" in shown) == refused
    assert ("mm RMS, more than its standard error" in shown) == refused
