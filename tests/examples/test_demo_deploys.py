"""Hidden effects of the demo: named, compensated by a rover; the demo accepts every model or says why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from examples.demo.hidden import KINDS, hidden_arm
from examples.demo.pose_files import LOAD_G, pose_table
from examples.demo.steps import DemoSteps
from lrm_math.arm.arm_file import load_arm as model_arm
from lrm_math.effects import compensable, effects_at
from tests.daemon.cli.test_deploy_check import COVARIANCE, DRIFTING, STATE, written
from validation.synthetic import load_arm, true_state
from validation.synthetic.example import ARM_FILE


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


ARM = load_arm(ARM_FILE)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(0, 30, 3))
def test_a_hidden_effect_moves_the_tip_and_has_a_name(seed: int) -> None:
    hidden = hidden_arm(ARM, seed)
    assert hidden == hidden_arm(ARM, seed)
    (effect,) = effects_at(model_arm("lrm-lab"), hidden.effect)
    assert compensable(effect)
    q = np.radians([[40.0, -50.0, 30.0, 60.0, -40.0, 20.0], [-70.0, 20.0, -60.0, -80.0, 70.0, -30.0]])
    without = type(hidden.truth)(
        hidden.truth.deviations, hidden.truth.displacements, hidden.truth.base_compliance_rad_per_nm,
        hidden.truth.joint_compliance_rad_per_nm,
    )  # fmt: skip
    moved = true_state(ARM, hidden.truth, q, 0.0663).tcp_m - true_state(ARM, without, q, 0.0663).tcp_m
    assert 1e-4 < np.linalg.norm(moved, axis=1).max() < 0.05


def test_every_kind_is_drawn() -> None:
    drawn = {hidden_arm(ARM, seed).effect.partition("@")[0] for seed in range(100)}
    assert drawn == {kind.name.partition("@")[0] for kind in KINDS}


def test_the_poses_carry_both_loads_and_repeats() -> None:
    lines = [line.split(",") for line in pose_table(model_arm("lrm-lab"), 30, 4, 1).splitlines()[1:]]
    assert {float(line[7]) for line in lines} == {0.0, LOAD_G}
    assert [line[0] for line in lines] == [str(k) for k in range(1, 31)]
    repeats = [line for line in lines if line[0] != line[8]]
    assert len(repeats) == 4
    for line in repeats:
        assert lines[int(line[8]) - 1][1:8] == line[1:8]
