"""The harness of `python -m validation.as_deployed` on a tiny case, and the laws of its worlds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from validation.as_deployed.catalogue import CATALOGUE, recording_of
from validation.as_deployed.faults import FAULTS, fault_recording
from validation.as_deployed.half_range import HalfRange
from validation.as_deployed.leaning import Lean, leaning_recording
from validation.as_deployed.outcome import examined, ratio
from validation.as_deployed.passing_world import PassingWorld
from validation.as_deployed.recording import FRESH, in_shown_frame
from validation.as_deployed.results import line_of, report, results_file
from validation.as_deployed.worlds import PARTS, OngoingCase, cases_of
from validation.synthetic import Schedule, true_state


@pytest.mark.slow
def test_a_case_is_examined_written_and_reported(tmp_path: Path) -> None:
    key = "catalogue/first/restart3/60/0"
    case = OngoingCase.of(key)
    record = {"hidden": case.hidden, **examined(case.record())}
    assert record["steps"][0]["added"] == "session@joint3"
    assert record["before_mm"] > 1.0
    assert ratio(record) == pytest.approx(record["after_mm"] / record["before_mm"])
    file = results_file(tmp_path / "out" / "found.json")
    file.write({key: record})
    known = file.read()
    assert known == {key: record}
    assert line_of(key, record).startswith(key)
    assert record["after_recorded_mm"] == pytest.approx(record["after_mm"])  # nothing of it follows time or moves
    assert "session@joint3" in report(known)


def test_keys_name_their_cases_once() -> None:
    cases = [case for part in PARTS for case in cases_of(part, [], (300, 80))]
    assert len({case.key for case in cases}) == len(cases)
    for case in cases:
        assert OngoingCase.of(case.key) == case
        assert case.part in ("loop", "real") or case.hidden


def test_fresh_poses_are_the_next_of_the_last_session() -> None:
    run = recording_of(CATALOGUE["first/restart1"], 0, 60)
    plan = run.whole.schedule
    assert len(run.tips_m) == FRESH
    assert (np.diff(plan.time_s) > 0.0).all()
    assert (plan.session[60:] == plan.session[59]).all()


@pytest.mark.long
def test_fresh_poses_lie_in_the_half_that_was_not_measured() -> None:
    q = recording_of(CATALOGUE["first/nothing"], 0, 60, HalfRange(3, -1)).whole.q_rad[:, 2]
    assert len(q) == 60 + FRESH
    assert (q[:60] <= 0.0).all()
    assert (q[60:] >= 0.0).all()


@pytest.mark.long
@pytest.mark.parametrize("name", ["first/nothing", "first/warm2"])
def test_without_an_erring_tracker_the_truth_differs_from_what_is_measured_by_noise(name: str) -> None:
    run = recording_of(CATALOGUE[name], 0, 60)
    assert np.std(run.whole.tcp_m[60:] - run.tips_m) == pytest.approx(3e-4, rel=0.1)


def test_truth_stands_in_the_frame_that_an_erring_tracker_shows() -> None:
    """A rigid motion is followed; a stretch is not, and is left as the tracker's error."""
    rng = np.random.default_rng(0)
    true, points = rng.normal(size=(2, 50, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    assert in_shown_frame(true, true @ turn.T + 0.3, points) == pytest.approx(points @ turn.T + 0.3)
    assert in_shown_frame(true, 1.1 * (true - true.mean(axis=0)), points) == pytest.approx(points - true.mean(axis=0))


def test_a_pushed_tracker_shows_its_last_frame() -> None:
    run = fault_recording(FAULTS["fault/tracker moved meanwhile"], 0, 60)
    apart = run.tips_m - run.whole.tcp_m[60:]  # where they are not measured, the true tips stand unmoved
    assert 1e-3 < np.linalg.norm(apart, axis=1).max() < 0.02


def test_a_lean_changes_the_direction_of_gravity_alone() -> None:
    tilted = leaning_recording(0, Lean("x", 5, 40)).whole.arm.gravity_m_per_s2
    assert np.linalg.norm(tilted) == pytest.approx(9.81)
    assert np.degrees(np.arccos(-tilted[2] / 9.81)) == pytest.approx(5.0)
    assert Lean.of(0).words == "level"


def test_the_world_of_the_loop_is_pushed_leans_and_ends_warm() -> None:
    """What passes while measuring is over afterwards, and the floor knows it: the same arm on a level base."""
    world = PassingWorld(3)
    (leaning, passing), (_, lasting), (level, known) = world.passing, world.lasting, world.level
    assert lasting == known
    assert leaning.gravity_m_per_s2 != level.gravity_m_per_s2
    q, load, late = np.full((1, 6), 0.3), np.zeros(1), Schedule(np.array([1e4]), np.ones(1), np.zeros(6))
    ends = [true_state(leaning, truth, q, load, late).tcp_m for truth in (passing, lasting)]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(np.diff(world.pushed(np.eye(3)), axis=0)), 2.0)
