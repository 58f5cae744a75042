"""Campaigns on a fake arm, tracker and clock: killed at any moment and resumed, no row is lost and none doubled."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.cli.campaign import _timing, conclude
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.measuring.campaign.data_file import ArmState, DataFile, PowerOn, after_midnight
from lrm_ident.measuring.campaign.plan import PlannedPose, lightest, load_plan
from lrm_ident.measuring.campaign.run import (
    CampaignProgress,
    CampaignResult,
    PoseCampaign,
    PoseTiming,
    PredictedSettling,
    Unreachable,
)
from lrm_ident.measuring.tracker.dwell import RestMean
from lrm_ident.measuring.tracker.frames import TargetNumbers, TargetPose, TrackerFrame
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import FileError, LrmError

ARM = load_arm("lrm-lab")
NUMBERS = TargetNumbers(1, None)
POSES = tuple(
    PlannedPose(k, tuple(np.random.default_rng(of).uniform(-1.5, 1.5, 6).tolist()), 0.0, (), of)
    for k in range(1, 21)
    for of in (k if k < 16 else k - 15,)
)


class KilledMidway(BaseException):
    """Error that stands for a kill."""


@dataclass
class FakeWorld:
    """Arm, tracker and clock in one: time passes in `sleep` and `frames`, and every step may be the last.

    `steps_left`: steps until it is killed. `fault`: called with a pose's number and the try, gives its frames another
    form. `warm`: poses before which a servo is warm. `moved`: whether somebody moves the arm during a pose's rest.
    """

    steps_left: int = 10**9
    fault: Callable[[int, int], bool] = lambda *_: False
    moved: Callable[[int, int], bool] = lambda *_: False
    refused: tuple[int, ...] = ()
    warm: tuple[int, ...] = ()
    t: float = 1000.0
    number: int = 0
    tries: dict[int, int] = field(default_factory=dict)
    settle_s: float | None = None
    at: PlannedPose | None = None
    cooled: list[int] = field(default_factory=list)
    loads: list[float] = field(default_factory=list)

    def step(self) -> None:
        self.steps_left -= 1
        if self.steps_left < 0:
            raise KilledMidway

    def now(self) -> float:
        return self.t

    def sleep(self, seconds: float) -> None:
        self.step()
        self.t += max(0.0, seconds)

    def go(self, pose: PlannedPose) -> ArmState:
        self.step()
        if pose.number in self.refused:
            raise Unreachable("no way: it collides")
        self.t += 3.0
        self.at, self.tries[pose.number] = pose, self.tries.get(pose.number, 0) + 1
        self.step()
        return ArmState(pose.q, (1,) * 6, 30.0, 1)

    def disturbed(self) -> str:
        self.step()
        assert self.at is not None
        return "somebody moved it" if self.moved(self.at.number, self.tries[self.at.number]) else ""

    def too_warm(self) -> str:
        self.step()
        number = 0 if self.at is None else self.at.number
        return "joint4 is warm" if number in self.warm and number not in self.cooled else ""

    def cool(self, rest: PlannedPose) -> None:
        self.cooled.append(self.at.number)

    def change_payload(self, payload: float) -> None:
        self.loads.append(payload)

    def frames(self, seconds: float) -> list[TrackerFrame]:
        self.step()
        self.t += seconds
        self.number += 100
        tip = np.array(self.at.q[:3]) * 0.1
        noise = np.random.default_rng(self.number).normal(scale=1e-4, size=(30, 3))
        if self.fault(self.at.number, self.tries[self.at.number]):
            noise[7] += 0.01
        return [
            TrackerFrame(self.number + k, self.t, {1: TargetPose(tip + row, np.eye(3))}) for k, row in enumerate(noise)
        ]


def run(
    world: FakeWorld, path: Path, told: list[CampaignProgress] | None = None, timing: PoseTiming | None = None
) -> dict[int, str]:
    """One go at the campaign; the numbers of the poses that could not be measured."""
    file = DataFile(path, 6)
    file.check_plan("plan")
    on_progress = (lambda _: None) if told is None else told.append
    with file:
        file.begin(PowerOn("power"), world.t, "lrm-lab", "test", start_q_deg=[0.0] * 6, poses_sha256="plan")
        campaign = PoseCampaign(world, world, NUMBERS, world, timing or PoseTiming(), POSES[0], on_progress)
        return campaign.run(POSES, file).failed


def check_complete(path: Path) -> None:
    """Every pose is in the file once, at its own place."""
    data = load_measurements(path, ARM)
    assert sorted(data.pose.tolist()) == [pose.number for pose in POSES]
    for number, tip, q in zip(data.pose.tolist(), data.tcp, data.poses.q, strict=True):
        np.testing.assert_allclose(tip, np.array(POSES[number - 1].q[:3]) * 0.1, atol=3e-4)
        np.testing.assert_allclose(q, POSES[number - 1].q, atol=1e-6)
    assert np.all(np.diff(data.poses.t) >= 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(50))
def test_killed_at_random_moments_and_resumed_it_is_complete(tmp_path: Path, seed: int) -> None:
    rng, path, world = np.random.default_rng(seed), tmp_path / "data.csv", FakeWorld()
    rows = 0
    for _ in range(200):
        world.steps_left = int(rng.integers(1, 60))
        try:
            run(world, path)
            break
        except KilledMidway:
            if path.exists() and rng.random() < 0.3:  # a kill within a write leaves a part of a line
                with path.open("ab") as file:
                    file.write(b"7,12.0,1,0.000,33.1"[: int(rng.integers(1, 19))])
        now = max(0, path.read_bytes().count(b"\n") - 1) if path.exists() else 0
        assert now >= rows
        rows = now
    check_complete(path)


def test_the_data_say_when_and_how_each_pose_was_measured(tmp_path: Path) -> None:
    told: list[CampaignProgress] = []
    path = tmp_path / "data.csv"
    assert run(FakeWorld(), path, told) == {}
    check_complete(path)
    data = load_measurements(path, ARM)
    assert data.source.notices == ()
    assert data.repeat_of.tolist() == [pose.repeat_of for pose in POSES]
    np.testing.assert_allclose(np.diff(data.poses.t), 15.0, atol=0.01)
    assert np.all(np.abs(data.sd - 1e-4) < 3e-5)
    assert [progress.done for progress in told] == list(range(1, 21))
    assert [progress.done for progress in told if progress.notable] == [1]
    assert told[9].left == pytest.approx(150.0, rel=0.05)


def test_a_stop_lasts_as_long_as_the_arm_says_that_its_tip_swings(tmp_path: Path) -> None:
    """The motion takes 3 s, the tracker is glanced at for 0.05 s, the mean takes 1 s."""
    told: list[CampaignProgress] = []
    path = tmp_path / "data.csv"
    assert run(FakeWorld(settle_s=1.25), path, told, PredictedSettling(15.0, 0.5, 1.0)) == {}
    np.testing.assert_allclose(np.diff(load_measurements(path, ARM).poses.t), 3.0 + 0.05 + 1.25 + 1.0, atol=0.01)
    assert "1.2 s after its motion" in told[0].words
    with pytest.raises(LrmError, match="does not know how long its tip swings"):
        run(FakeWorld(), tmp_path / "other.csv", told, PredictedSettling(15.0, 0.5, 1.0))


def test_a_pose_is_held_as_long_as_its_file_says_and_the_memory_of_the_data_knows(tmp_path: Path) -> None:
    """From the design's file to the step of the history; a shorter hold than the usual stop changes nothing."""
    holds = [0.0, 40.0, 5.0, 120.0]
    rows = [f"{k + 1},{10.0 * k},0,0,0,0,0,0,{hold}" for k, hold in enumerate(holds)]
    (tmp_path / "next.csv").write_text(
        "\n".join(["pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,payload_g,hold_s", *rows])
    )
    plan = load_plan(tmp_path / "next.csv", ARM)
    assert [pose.hold for pose in plan.poses] == holds
    with (file := DataFile(tmp_path / "data.csv", 6)):
        world = FakeWorld()
        file.begin(PowerOn("power"), world.t, "lrm-lab", "test", start_q_deg=[0.0] * 6, poses_sha256="plan")
        timing = PoseTiming(15.0, 0.5, 1.0)
        PoseCampaign(world, world, NUMBERS, world, timing, POSES[0], lambda _: None).run(plan.poses, file)
    poses = load_measurements(tmp_path / "data.csv", ARM).poses
    np.testing.assert_allclose(poses.history.visits.step, [0.0, 44.05, 15.0, 124.05], atol=0.06)


def test_a_file_without_times_has_the_steps_that_it_was_to_be_held(tmp_path: Path) -> None:
    """Measured by hand after a design: equal steps, and what each pose was held."""
    header = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,hold_s,x_mm,y_mm,z_mm"
    rows = [f"{k + 1},{10 * k},0,0,0,0,0,{60 * (k % 2)},300,{k},200" for k in range(4)]
    (tmp_path / "hand.csv").write_text("\n".join([header, *rows]))
    history = load_measurements(tmp_path / "hand.csv", ARM).poses.history
    assert history.visits.step.tolist() == [0.0, 70.0, 10.0, 70.0]
    assert not history.visits.timed


def test_settle_takes_seconds_or_auto() -> None:
    assert _timing(15.0, "0.7", 1.0, None) == PoseTiming(15.0, 0.7, 1.0)
    assert isinstance(_timing(15.0, "auto", 1.0, None), PredictedSettling)
    with pytest.raises(LrmError, match="leave out --motion"):
        _timing(15.0, "auto", 1.0, Path("motion.toml"))
    for text in ("soon", "-1", "nan", "inf"):
        with pytest.raises(LrmError, match="should be seconds, 0 or more, or auto"):
            _timing(15.0, text, 1.0, None)


def test_an_unfit_rest_is_repeated_and_one_that_stays_unfit_is_said(tmp_path: Path) -> None:
    world = FakeWorld(fault=lambda number, tries: (number == 3 and tries == 1) or number == 5, refused=(9,))
    failed = run(world, path := tmp_path / "data.csv")
    assert (world.tries[3], world.tries[5]) == (2, 3)
    assert failed.keys() == {5, 9}
    assert "outliers" in failed[5]
    assert load_measurements(path, ARM).pose.tolist() == [n for n in range(1, 21) if n not in failed]
    assert run(FakeWorld(), path) == {}
    check_complete(path)


def test_the_row_of_an_arm_that_was_moved_during_its_rest_is_dropped_and_said(tmp_path: Path) -> None:
    told: list[CampaignProgress] = []
    world = FakeWorld(moved=lambda number, tries: (number == 3 and tries == 1) or number == 5)
    assert run(world, path := tmp_path / "data.csv", told) == {5: "somebody moved it"}
    dropped = [one.words for one in told if "dropped" in one.words]
    assert dropped == [f"pose {number}: its row is dropped: somebody moved it" for number in (3, 5, 5, 5)]
    assert load_measurements(path, ARM).pose.tolist() == [n for n in range(1, 21) if n != 5]


@pytest.mark.long
@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 2)), min_size=1, max_size=6))
def test_a_session_is_another_exactly_where_the_servos_were_switched_on_anew(runs: list[tuple[str, int]]) -> None:
    """Each run of the command: the name of the power-on session, and the rows that are measured before it ends."""
    rest, expected = RestMean(np.zeros(3), 1e-4, 1000.0, 30), list[tuple[str, int]]()
    with TemporaryDirectory() as folder:
        for name, rows in runs:
            with DataFile(path := Path(folder) / "data.csv", 6) as file:
                session = file.begin(PowerOn(name), 1000.0, "lrm-lab", "test", poses_sha256="plan")
                before = expected[-1] if expected else (name, 1)
                assert session == before[1] + (before[0] != name)
                for _ in range(rows):
                    number = len(expected) + 1
                    file.append(
                        PlannedPose(number, (0.0,) * 6, 0.0, (), number),
                        ArmState((0.0,) * 6, (0,) * 6, 30.0, session),
                        rest,
                    )
                    expected.append((name, session))
        column = [int(line.split(",")[2]) for line in path.read_text().splitlines()[1:]]
    assert column == [session for _, session in expected]


@given(st.lists(st.tuples(st.floats(0.0, 1e4), st.floats(0.0, 1e5), st.booleans()), min_size=1, max_size=4))
def test_the_poses_know_since_when_their_session_has_power(sessions: list[tuple[float, float, bool]]) -> None:
    """Each session: time from its power-on to its first row (s), time since the row before, whether it is known.

    The tracker's clock begins anew every midnight.
    """
    t, expected = 86_000.0, list[float]()
    with TemporaryDirectory() as folder:
        for number, (ago, gap, known) in enumerate(sessions, start=1):
            t += gap + 1.0 if gap < 4e4 else 1.0
            with DataFile(path := Path(folder) / "data.csv", 6) as file:
                session = file.begin(
                    PowerOn(str(number), ago if known else None, 20.0 + number), t % 86_400.0, "lrm-lab", "test"
                )
                for row in range(2):
                    rest = RestMean(np.full(3, 0.1), 1e-4, (t + 10.0 * row) % 86_400.0, 30)
                    state = ArmState((0.0,) * 6, (0,) * 6, 30.0, session)
                    file.append(PlannedPose(len(expected) + 1, (0.0,) * 6, 0.0, (), len(expected) + 1), state, rest)
                    expected.append(10.0 * row + (ago if known else 0.0))
            t += 10.0
        poses = load_measurements(path, ARM).poses
    np.testing.assert_allclose(poses.running, expected, atol=2e-3)
    assert poses.t is not None
    if sessions[0][2]:
        np.testing.assert_allclose(poses.powered, poses.t + sessions[0][0], atol=2e-3)
        np.testing.assert_allclose(poses.warmed, 9.0)
    else:
        assert poses.powered is None
    assert poses.take([-1]).warmed == poses.warmed[-1]


def test_a_repeat_of_a_pose_that_is_missing_stands_for_itself(tmp_path: Path) -> None:
    run(FakeWorld(refused=(1,)), path := tmp_path / "data.csv")
    data = load_measurements(path, ARM)
    assert data.repeat_of[data.pose == 16].tolist() == [16]


def test_it_cools_before_it_goes_on(tmp_path: Path) -> None:
    world = FakeWorld(warm=(4, 11))
    run(world, path := tmp_path / "data.csv")
    assert world.cooled == [4, 11]
    check_complete(path)


def test_other_poses_and_other_files_are_refused(tmp_path: Path) -> None:
    run(FakeWorld(), path := tmp_path / "data.csv")
    before = path.read_bytes()
    with pytest.raises(FileError, match="other poses"):
        DataFile(path, 6).check_plan("another plan")
    with pytest.raises(FileError, match="not that of this campaign"):
        DataFile(path, 5)
    assert path.read_bytes() == before


def test_a_clock_that_starts_again_at_midnight_goes_on() -> None:
    assert after_midnight(100.0, 90.0) == 100.0
    assert after_midnight(-86_300.0, 90.0) == 100.0
    assert after_midnight(-86_350.0, 86_399.0) == pytest.approx(86_450.0)


def test_a_plan_is_read_as_design_writes_it(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    head = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,payload_g,approach,repeat_of\n"
    path.write_text(head + "1,0,10,20,30,40,50,66.3,1,1\n2,0,10,20,30,40,50,66.3,-1,1\n")
    plan = load_plan(path, ARM)
    assert [(p.number, p.approach, p.repeat_of) for p in plan.poses] == [(1, (1,) * 6, 1), (2, (-1,) * 6, 1)]
    np.testing.assert_allclose(plan.poses[0].q, np.radians([0, 10, 20, 30, 40, 50]))
    assert plan.poses[0].payload == pytest.approx(0.0663)
    assert lightest(plan.poses, ARM) in plan.poses
    path.write_text(head + "1,0,10,20,30,40,50,66.3,1,1\n1,0,10,20,30,40,51,66.3,-1,1\n")
    with pytest.raises(FileError, match="stands twice"):
        load_plan(path, ARM)


def test_the_orientation_reaches_the_file_where_it_is_asked_for(tmp_path: Path) -> None:
    """A row has the rotation's quaternion, or empty cells where the tracker did not see it."""
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    seen = RestMean(np.zeros(3), 1e-4, 1000.0, 30, turned, math.radians(0.05))
    state = ArmState((0.0,) * 6, (0,) * 6, 25.0, 1)
    with DataFile(path := tmp_path / "data.csv", 6, orientation=True) as file:
        file.begin(PowerOn("power"), 0.0, "lrm-lab", "test", start_q_deg=[0.0] * 6, poses_sha256="plan")
        file.append(POSES[0], state, seen)
        file.append(POSES[1], state, replace(seen, rotation=None, turn_sd=None))
    header, first, second = (line.split(",") for line in path.read_text().splitlines())
    assert header[-5:] == ["qw", "qx", "qy", "qz", "srot_deg"]
    assert [float(cell) for cell in first[-5:]] == pytest.approx([0.5**0.5, 0.0, 0.0, 0.5**0.5, 0.05], abs=1e-6)
    assert second[-5:-1] == [""] * 4
    with pytest.raises(FileError, match="is not that of this campaign"):
        DataFile(path, 6)


@given(total=st.integers(1, 9), failed=st.integers(0, 9))
def test_a_campaign_without_any_pose_is_an_error_and_no_other_is(total: int, failed: int) -> None:
    failed = min(failed, total)
    result = CampaignResult({number + 1: "no way" for number in range(failed)})
    if failed == total:
        with pytest.raises(LrmError, match="no pose was measured; no way"):
            conclude(result, total, Path("data.csv"))
    else:
        conclude(result, total, Path("data.csv"))
