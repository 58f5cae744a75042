"""Foreign clients and foreign files may not flood its events, stop it by accident, fool it."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
import zenoh

from lrmd.client import NoReply, RequestRefused
from lrmd.config import load_config
from lrmd.messages.codec import pack
from lrmd.messages.control import Event, LeaseRequest
from lrmd.messages.kinematics import FkRequest, GoalEntry, IkRequest
from lrmd.messages.zenoh_session import ACCEPT_TIMEOUT_MS, client
from lrmd.persistence import state_file
from lrmd.persistence.state_file import StoredState
from tests.support.daemon.daemon_harness import DaemonHarness, arm_when_ready, connected
from tests.support.daemon.daemon_process import BoardProcess, DaemonProcess, DaemonSetup, wait_for

BAD_MESSAGES, TAKES = 600, 400


def count(harness: DaemonHarness, code: str) -> int:
    """Number of events of a code, those that were only counted included."""
    return sum(int(str(e.detail.get("count", 1))) for e in harness.events() if e.code == code)


@pytest.fixture
def stranger(harness: DaemonHarness) -> Iterator[zenoh.Session]:
    """A foreign session with zenoh alone."""
    with zenoh.open(client([harness.setup.endpoint])) as session:
        yield session


def test_bad_messages_are_counted_and_displace_no_other_event(own: DaemonHarness) -> None:
    with own.rover.control("test"), zenoh.open(client([own.setup.endpoint])) as stranger:
        own.arm()
        before = own.codes()
        assert {"link_up", "mode"} <= set(before)
        started = time.monotonic()
        for number in range(BAD_MESSAGES):
            stranger.put(own.setup.key("cmd/target"), b"\xc1 no message %d" % number)
        wait_for(lambda: count(own, "refused") == BAD_MESSAGES, "each is counted")
        seconds = time.monotonic() - started
    assert [code for code in own.codes() if code != "refused"][: len(before)] == before
    assert own.daemon.codes().count("refused") <= 11 * (seconds + 1)


def test_a_fight_for_the_lease_is_a_few_lines_in_the_log(own: DaemonHarness) -> None:
    started = time.monotonic()
    with zenoh.open(client([own.setup.endpoint])) as stranger:
        for number in range(TAKES):
            request = pack(LeaseRequest(action="acquire", holder=f"fighter {number % 2}", take=True))
            assert [r.ok is not None for r in stranger.get(own.setup.key("rpc/lease"), payload=request)] == [True]
    wait_for(lambda: count(own, "lease_taken") + count(own, "lease_lost") == TAKES, "each is counted")
    assert own.daemon.codes().count("lease_taken") <= 11 * (time.monotonic() - started + 1)


def test_connections_that_say_nothing_stop_nobody_and_keep_newcomers_out_for_moments(harness: DaemonHarness) -> None:
    with ExitStack() as silent:
        for _ in range(300):
            silent.enter_context(socket.create_connection(("127.0.0.1", harness.setup.port), timeout=5.0))
        assert harness.mode() == "disarmed"

        def newcomer() -> bool:
            with suppress(NoReply), harness.setup.rover() as rover:
                return rover.mode().mode == "disarmed"
            return False

        wait_for(newcomer, "a new client is let in", seconds=3 * ACCEPT_TIMEOUT_MS / 1000)


def test_only_its_own_keys_are_an_emergency_stop(harness: DaemonHarness, stranger: zenoh.Session) -> None:
    with harness.rover.control("test"):
        harness.arm()
        for wildcard in ("lrm/**", "**", "lrm/rover/**", "lrm/rover/cmd/*", "lrm/**/estop"):
            for payload in (b"", b"anything", pack(Event(
                boot_id="", seq=0, t_mono_ns=0, t_wall_ns=0, code="x", level="info", text="not for the daemon"
            ))):  # fmt: skip
                stranger.put(wildcard, payload)
        wait_for(lambda: "refused" in harness.codes(), "they are told of")
        time.sleep(0.2)
        assert harness.mode() == "armed"
        assert len(harness.pulses()) == 6
        stranger.put("lrm/*/cmd/estop", b"")
        wait_for(lambda: harness.pulses() == [], "one for all robots stops this one")
        assert harness.mode() == "estop"


def test_ready_means_that_kinematics_are_answered(tmp_path: Path) -> None:
    setup = DaemonSetup.make(tmp_path)
    with BoardProcess(setup), DaemonProcess(setup) as daemon, daemon.ready().setup.rover() as rover:
        assert rover.ik(IkRequest(goals=[GoalEntry(position_m=[0.2, 0.1, 0.3])], method="direct")).answers
        assert rover.metrics().ticks > 0


def test_kinematics_carry_what_the_last_move_said(harness: DaemonHarness) -> None:
    def torque(payload: float | None) -> list[float]:
        return harness.rover.fk(FkRequest(q_rad=[[0.0] * 6], payload_kg=payload)).places[0].tau_nm

    assert torque(None) == torque(0.0)
    with harness.rover.control("test"):
        harness.arm()
        harness.rover.move({"joint1": 0.01}, payload_kg=0.2)
    assert torque(None) == torque(0.2) != torque(0.0)


FOREIGN = {
    "another arm's": (
        {"arm": "lrm-lab", "identity": "0" * 64},
        "the state of lrm-lab, and this daemon drives lrm-rover",
    ),
    "another table's": ({"arm": "lrm-rover", "identity": "0" * 64}, "servo tables of lrm-rover were changed"),
    "an older release's": ({}, "an older release wrote it"),
}


@pytest.mark.parametrize("whose", FOREIGN)
def test_foreign_pulses_are_not_taken_for_the_stored_pose(tmp_path: Path, whose: str) -> None:
    identity, words = FOREIGN[whose]
    setup = DaemonSetup.make(tmp_path)
    setup.state.mkdir()
    pulses = {servo.name: (servo.lowest + servo.highest) // 2 for servo in load_config(setup.config).servos}
    content = {"saved_wall_ns": 1, "boots": 7, "mode": "armed", "still": True, "pulse_ns": pulses, "temperature_c": {}}
    state_file.save(setup.state, StoredState(**content))
    path = setup.state / state_file.NAME
    kept = {"schema": "lrm/state/1", **content, **identity}
    path.write_text(str(kept).replace("'", '"').replace("True", "true"), encoding="utf-8")
    with BoardProcess(setup) as board, connected(setup) as (_, rover):
        assert rover.info().stored_rad == {}
        assert [words in e.text for e in rover.events() if e.code == "state_foreign"] == [True]
        with rover.control("test"), pytest.raises(RequestRefused, match="no pose was stored"):
            arm_when_ready(rover, "stored")
        time.sleep(0.2)
        assert board.pulses() == []
    assert (setup.state / "state.foreign").exists()
