"""Skills on a simulated daemon: what each outcome takes, and that nothing of an ended skill moves anything."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.messages.control import HoldRequest, LeaseRequest, MoveRequest, PayloadRequest
from lrmd.messages.skills import SenseCommand, SkillRequest
from tests.support.daemon.skilled_daemon import GOAL, THERE, SkilledDaemon, reply


@pytest.fixture
def arm() -> SkilledDaemon:
    return SkilledDaemon()


@pytest.mark.long
def test_the_skills_of_a_fetch_one_after_the_other(arm: SkilledDaemon) -> None:
    fetch: list[tuple[str, dict[str, Any]]] = [
        ("approach", {"goal": GOAL, "height_m": 0.05, "gripper_rad": 0.2}), ("touch_down", {"goal": GOAL}),
        ("grasp", {"gripper_rad": -0.1, "payload_kg": 0.03, "payload_centre_m": [0.0, 0.01, 0.02]}),
        ("retreat", {"height_m": 0.05}),
        ("carry", {"goal": GOAL}), ("drop", {"gripper_rad": 0.2}), ("stow", {"q_rad": [0.0] * 6}),
    ]  # fmt: skip
    loads = []
    for number, (name, fields) in enumerate(fetch, start=1):
        arm.begin(name, **fields)
        arm.keep(900, answers=True)
        assert (arm.core.skill_report.number, arm.core.skill_report.skill, arm.outcome) == (number, name, "reached")
        loads.append((arm.core.payload, *arm.core.load_at))
    empty, carried = (0.0, 0.0, 0.0, 0.0), (0.03, 0.0, 0.01, 0.02)
    assert loads == [empty, empty, carried, carried, carried, empty, empty]
    assert arm.q[:6] == pytest.approx([0.0] * 6, abs=1e-3)
    assert arm.q[arm.config.index("gripper")] == pytest.approx(0.2, abs=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("when", ["planning", "moving"])
@pytest.mark.parametrize("how", ["hold", "estop", "lease lost", "released", "taken"])
def test_a_skill_ends_where_its_client_or_anybody_stops_it(arm: SkilledDaemon, when: str, how: str) -> None:
    arm.begin("stow", q_rad=THERE)
    arm.keep(20, answers=when == "moving")
    assert arm.core.mode is (Mode.MOVING if when == "moving" else Mode.ARMED)
    match how:
        case "hold":
            arm.core.handle(HoldRequest(), arm.now)
        case "estop":
            arm.core.estop(arm.now, "test")
        case "lease lost":
            arm.run(200)
        case "released":
            arm.core.handle(LeaseRequest(action="release", lease=arm.lease), arm.now)
        case _:
            arm.core.handle(LeaseRequest(action="acquire", holder="other", take=True), arm.now)
    question = arm.core.question
    arm.run(10)
    stood = arm.q
    if question is not None:
        arm.core.answer(question[0], reply(question[1]), arm.now)
    arm.run(200)
    assert arm.outcome == "stopped"
    assert arm.q == stood


def test_another_motion_takes_its_place(arm: SkilledDaemon) -> None:
    arm.begin("stow", q_rad=THERE)
    arm.keep(20)
    arm.core.handle(MoveRequest(lease=arm.lease, waypoints=[{"joint1": -0.05}]), arm.now)
    arm.keep(300, answers=True)
    assert arm.outcome == "replaced"
    assert arm.q[:6] == pytest.approx([-0.05, 0, 0, 0, 0, 0], abs=1e-3)


def test_a_touch_ends_the_way_down_and_no_other(arm: SkilledDaemon) -> None:
    arm.begin("stow", q_rad=[-0.2] * 6)
    arm.keep(20, answers=True)
    arm.core.handle(SenseCommand(what="touch"), arm.now)
    arm.keep(300, answers=True)
    assert arm.outcome == "reached"
    arm.begin("touch_down", goal=GOAL)
    arm.keep(20, answers=True)
    arm.core.handle(SenseCommand(what="touch"), arm.now)
    arm.keep(200, answers=True)
    assert (arm.outcome, arm.core.mode) == ("touched_early", Mode.HOLDING)
    assert arm.q[0] < 0.5


def test_a_hot_arm_that_touched_something_does_not_go_to_rest_at_once(arm: SkilledDaemon) -> None:
    """As after a hold: what it touches may be in its way."""
    arm.begin("touch_down", goal=GOAL)
    arm.keep(20, answers=True)
    arm.core.handle(SenseCommand(what="touch"), arm.now)
    arm.core.thermal.temperature = (88.0,) * len(arm.config.servos)
    arm.keep(20)
    there = arm.q
    arm.keep(400)
    assert (arm.core.mode, arm.q) == (Mode.HOLDING, there)


def test_an_empty_gripper_carries_nothing(arm: SkilledDaemon) -> None:
    arm.begin("grasp", gripper_rad=-0.05, payload_kg=0.03, listen_s=0.5)
    arm.keep(100)
    assert arm.outcome == "running"
    arm.core.handle(SenseCommand(what="empty"), arm.now)
    arm.keep(200)
    assert (arm.outcome, arm.core.payload) == ("nothing_there", 0.0)


def test_the_pose_of_a_skill_under_way_is_not_one_to_arm_at(arm: SkilledDaemon) -> None:
    """Also while it waits: it moves the arm again without a request before which the pose is taken back."""
    assert arm.core.saved(1).still
    arm.begin("grasp", gripper_rad=-0.05, payload_kg=0.03, listen_s=0.5)
    arm.keep(100)
    assert (arm.outcome, arm.core.report.moving) == ("running", False)
    assert not arm.core.saved(1).still
    arm.core.handle(SenseCommand(what="empty"), arm.now)
    arm.keep(200)
    assert arm.outcome == "nothing_there"
    assert arm.core.saved(1).still


@pytest.mark.long
def test_what_cannot_be_reached_or_is_not_answered_is_refused(arm: SkilledDaemon) -> None:
    arm.begin("approach", goal=GOAL, height_m=0.05)
    arm.keep(20, answers=True, found=False)
    assert arm.outcome == "refused"
    arm.begin("retreat", height_m=0.05)
    arm.keep(round(20.0 * 1e9 / arm.config.tick))
    assert (arm.outcome, arm.core.mode) == ("refused", Mode.ARMED)
    assert "no answer" in arm.core.skill_report.text


def test_an_answer_to_a_skill_before_is_ignored(arm: SkilledDaemon) -> None:
    arm.begin("stow", q_rad=[-0.2] * 6)
    arm.keep(20)
    before = arm.core.question
    arm.core.handle(HoldRequest(), arm.now)
    arm.keep(20)
    arm.begin("stow", q_rad=THERE)
    arm.keep(20)
    arm.core.answer(before[0], reply(before[1]), arm.now)
    arm.keep(20)
    assert (arm.outcome, arm.core.mode) == ("running", Mode.HOLDING)


def test_preconditions(arm: SkilledDaemon) -> None:
    with pytest.raises(RequestError, match="carries nothing"):
        arm.begin("carry", goal=GOAL)
    arm.core.handle(PayloadRequest(lease=arm.lease, payload_kg=0.01), arm.now)
    with pytest.raises(RequestError, match="carries 10 g already"):
        arm.begin("grasp", gripper_rad=0.0, payload_kg=0.03)
    arm.core.handle(MoveRequest(lease=arm.lease, waypoints=[{"joint1": 0.1}]), arm.now)
    with pytest.raises(RequestError, match="the arm moves"):
        arm.begin("stow", q_rad=THERE)
    arm.keep(200)
    arm.begin("stow", q_rad=THERE)
    with pytest.raises(RequestError, match="stow is under way"):
        arm.begin("stow", q_rad=THERE)
    arm.core.handle(HoldRequest(), arm.now)
    with pytest.raises(RequestError, match="was stopped since"):
        arm.core.handle(SkillRequest(lease=arm.lease, stops=0, skill="stow", q_rad=THERE), arm.now)


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"skill": "approach", "goal": GOAL}, "height_m is missing"),
        ({"skill": "stow", "q_rad": THERE, "goal": GOAL}, "goal is none of them"),
        ({"skill": "grasp", "gripper_rad": 0.0}, "payload_kg is missing"),
        ({"skill": "drop", "gripper_rad": 0.0, "listen_s": 1.0}, "listen_s is none of them"),
    ],
)
def test_a_skill_has_its_own_fields(fields: dict[str, Any], text: str) -> None:
    with pytest.raises(ValidationError, match=text):
        SkillRequest(lease="x", **fields)
