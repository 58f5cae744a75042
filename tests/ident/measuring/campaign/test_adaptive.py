"""Adaptive measuring: it takes of a plan what it needs, says what that saved, and goes on after a kill."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.design.adaptive_batch import BATCH, FIRST_BATCH, AdaptiveFindings, StoppingGoal
from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.measuring.campaign import adaptive
from lrm_ident.measuring.campaign.adaptive import AdaptiveCampaign
from lrm_ident.measuring.campaign.data_file import ArmState, DataFile, PowerOn
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.run import PoseCampaign, PoseTiming, Unreachable
from lrm_ident.measuring.tracker.frames import TargetNumbers, TargetPose, TrackerFrame
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.commands import stderr_of

pytestmark = pytest.mark.usefixtures("one_step_folds")

ARM = load_arm("two-joint")
TRUE = model_of(ARM, effects_at(ARM, "offsets"), {"offsets.joint2.theta_rad": 0.02, "offsets.joint1.a_mm": 0.002})
RNG = np.random.default_rng(0)
PLAN = tuple(
    PlannedPose(k, tuple(RNG.uniform(-1.5, 1.5, ARM.dof).tolist()), 0.0, (), k) for k in range(1, 121)
)  # fmt: skip


@dataclass
class TwoJointRig:
    """Arm, tracker and clock in one; `noise` in m, of a rest. `lives`: poses until it is killed."""

    noise: float = 3e-4
    lives: int = 10**9
    at: tuple[float, ...] = ()
    number: int = 0
    refused: tuple[int, ...] = ()
    visited: list[int] = field(default_factory=list)

    def go(self, pose: PlannedPose) -> ArmState:
        self.lives -= 1
        if self.lives < 0:
            raise KeyboardInterrupt
        if pose.number in self.refused:
            raise Unreachable("no way")
        self.at = pose.q
        self.visited.append(pose.number)
        return ArmState(pose.q, (1,) * ARM.dof, 30.0, 1)

    def frames(self, seconds: float) -> list[TrackerFrame]:
        self.number += 100
        rng = np.random.default_rng(self.number)
        tip = solve_equilibrium(TRUE, poses_of(np.array([self.at]))).tcp[0] + rng.normal(scale=self.noise, size=3)
        places = tip + rng.normal(scale=1e-5, size=(20, 3))
        return [
            TrackerFrame(self.number + k, float(self.number), {1: TargetPose(p, np.eye(3))})
            for k, p in enumerate(places)
        ]

    def disturbed(self) -> str:
        return ""

    def too_warm(self) -> str:
        return ""

    def cool(self, rest: PlannedPose) -> None: ...
    def change_payload(self, payload: float) -> None: ...
    def sleep(self, seconds: float) -> None: ...
    def now(self) -> float:
        return 0.0


def run(rig: TwoJointRig, path: Path, goal: StoppingGoal) -> list[str]:
    """Output of the command."""
    told: list[str] = []
    file = DataFile(path, ARM.dof)
    with file:
        file.begin(PowerOn("power"), 0.0, "two-joint", "test", poses_sha256="plan")
        campaign = PoseCampaign(rig, rig, TargetNumbers(1, None), rig, PoseTiming(), PLAN[0], lambda _: None)
        AdaptiveCampaign(campaign, ARM, goal, told.append).run(PLAN, file)
    return told


@pytest.mark.slow
def test_it_stops_when_the_error_is_surely_small_and_says_what_that_saved(tmp_path: Path) -> None:
    told = run(rig := TwoJointRig(), path := tmp_path / "data.csv", StoppingGoal(error=0.7e-3))
    data = load_measurements(path, ARM)
    assert FIRST_BATCH < len(data) < len(PLAN)
    assert len(set(rig.visited)) == len(rig.visited)
    assert (data.repeat_of != data.pose).sum() >= FIRST_BATCH // 8, "some are measured twice"
    assert f"{len(data)} poses are enough, 120 were offered" in told[-1]
    assert "held-out error" in told[0]
    assert run(TwoJointRig(lives=0), path, StoppingGoal(error=0.7e-3))[-1] == told[-1], "nothing is left to measure"


@pytest.mark.slow
def test_killed_it_goes_on_where_it_was(tmp_path: Path) -> None:
    path, rig = tmp_path / "data.csv", TwoJointRig(lives=7)
    with pytest.raises(KeyboardInterrupt):
        run(rig, path, StoppingGoal(error=0.7e-3))
    assert len(load_measurements(path, ARM)) == 7
    rig.lives = 10**9
    run(rig, path, StoppingGoal(error=0.7e-3))
    numbers = load_measurements(path, ARM).pose.tolist()
    assert len(set(numbers)) == len(numbers)
    assert numbers == rig.visited


def unsure(error: float = 1e-3, names: tuple[str, ...] = ("a@b", "c@d")) -> AdaptiveFindings:
    return AdaptiveFindings(TRUE, (names,), (), TRUE, Verdict.NOTHING_MISSING, error, error, 3e-4)


def given(monkeypatch: pytest.MonkeyPatch, *findings: AdaptiveFindings) -> None:
    """ModelReport one after the other, the last one again and again."""
    left = list(findings)
    monkeypatch.setattr(adaptive, "assess", lambda _: left.pop(0) if len(left) > 1 else left[0])
    chosen: Callable[..., object] = lambda *args: np.arange(min(BATCH, len(args[2])))  # noqa: E731
    monkeypatch.setattr(adaptive, "next_rows", chosen)
    monkeypatch.setattr(adaptive, "random_poses_as_good", lambda *_: 100)


@pytest.mark.long
def test_a_name_is_sure_when_it_is_the_only_one_twice(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    sure = unsure(names=("a@b",))
    given(monkeypatch, unsure(), sure, unsure(names=("e@f",)), sure, sure)
    told = run(TwoJointRig(), tmp_path / "data.csv", StoppingGoal(explain=True))
    assert len(told) == 6
    assert "a@b or c@d" in told[0]
    assert "poses are enough" in told[-1]


@pytest.mark.slow
def test_what_is_never_enough_measures_all_and_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    given(monkeypatch, unsure())
    rig = TwoJointRig(refused=(5, 9))
    told = run(rig, tmp_path / "data.csv", StoppingGoal(error=1e-4))
    assert "that is not enough" in told[-1]
    assert {number for number in rig.visited if number <= len(PLAN)} == set(range(1, 121)) - {5, 9}


@pytest.mark.slow
def test_a_fit_that_fails_is_said_and_more_is_measured(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fails(_: object) -> AdaptiveFindings:
        raise LrmError("no convergence")

    monkeypatch.setattr(adaptive, "assess", fails)
    told = run(TwoJointRig(), tmp_path / "data.csv", StoppingGoal(error=1e-3))
    assert "no convergence" in told[0]
    assert "that is not enough" in told[-1]


@pytest.mark.parametrize("until", ["0.6", "mm", "-1mm", "0mm", "1e-3m", "six mm"])
def test_until_wants_a_length_with_its_unit(until: str, tmp_path: Path) -> None:
    words = ("measure", tmp_path / "p.csv", "--tracker", "dtrack:5000", "-o", tmp_path / "d.csv", f"--until={until}")
    assert "such as 0.6mm" in stderr_of(*words)
