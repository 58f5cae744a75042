"""One daemon, one board: what is refused of imitators, another protocol, a namesake, and a daemon begun anew."""

from __future__ import annotations

import os
import signal
import time
import tty
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
import zenoh

from lrmd.cli import app
from lrmd.client import DaemonRestarted, FkRequest, RequestRefused, Rover, SeveralDaemons
from lrmd.link import protocol
from lrmd.link.frames import Frame, FrameDecoder, FrameType, encode
from lrmd.messages.codec import ErrorReply, pack, unpack
from lrmd.messages.control import ArmRequest, JointsState, Reply
from lrmd.messages.zenoh_session import client
from tests.support.background import repeated
from tests.support.daemon.daemon_harness import HOME, arm_when_ready, wait_for_link
from tests.support.daemon.daemon_process import SLOW_BOARD, BoardProcess, DaemonProcess, DaemonSetup, wait_for
from tests.support.daemon.forger import TRIES, accepted, forged


@contextmanager
def board_of_version(path: Path, version: int) -> Iterator[None]:
    """A board that answers every HELLO with an INFO of another version, of whatever length it has there."""
    master, slave = os.openpty()
    tty.setraw(slave)
    path.symlink_to(os.ttyname(slave))
    decoder = FrameDecoder()
    os.set_blocking(master, False)

    def answer() -> None:
        with suppress(BlockingIOError):
            for frame in decoder.feed(os.read(master, 4096)):
                if isinstance(frame, Frame) and frame.type == FrameType.HELLO:
                    os.write(master, encode(Frame(FrameType.INFO, frame.seq, 0b1111, (version, 7, 8, 9))))

    try:
        with repeated(answer, 0.002):
            yield
    finally:
        path.unlink()
        os.close(master)
        os.close(slave)


def test_another_protocol_is_named_once_with_advice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    setup = DaemonSetup.make(tmp_path)
    with board_of_version(setup.link, protocol.VERSION + 1), DaemonProcess(setup) as daemon:
        daemon.ready()
        with setup.rover() as rover:
            wait_for(lambda: "board_version" in [event.code for event in rover.events()], "the event")
            time.sleep(1.0)
            told = [event for event in rover.events() if event.code == "board_version"]
            logged = [entry for entry in daemon.log_entries() if entry["event"] == "board_version"]
            assert (len(told), len(logged), told[0].level) == (1, 1, "error")
            for text in (told[0].text, str(logged[0]["text"])):
                assert f"speaks protocol {protocol.VERSION + 1}" in text
                assert f"needs {protocol.VERSION}" in text
                assert "flash the firmware/" in text
            assert told[0].detail == {"board": protocol.VERSION + 1, "needed": protocol.VERSION}
            with rover.control("test"), pytest.raises(RequestRefused, match="flash the firmware/") as refused:
                rover.arm("given", HOME)
            assert refused.value.code == "link"
        assert app.main(["--connect", setup.endpoint, "state"]) == 0
        assert told[0].text in capsys.readouterr().out


def refusals(setup: DaemonSetup) -> set[str]:
    """Codes of everybody's answer to a request to arm."""
    request = pack(ArmRequest(lease="of whomever", where="given", q_rad=HOME))
    with zenoh.open(client([setup.endpoint])) as session:
        replies = list(session.get(setup.key("rpc/arm"), payload=request, timeout=5.0))
        assert all(reply.ok is None for reply in replies)
        return {unpack(ErrorReply, reply.err.payload.to_bytes()).code for reply in replies if reply.err is not None}


def test_a_second_daemon_of_the_name_is_noticed_by_both_at_start_and_when_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        folder.mkdir()
    first = DaemonSetup.make(folders[0])
    second = DaemonSetup.make(folders[1], {"connect = []": f'connect = ["{first.endpoint}"]'})
    with ExitStack() as running:
        for setup in (first, second):
            running.enter_context(BoardProcess(setup))
        daemon = running.enter_context(DaemonProcess(first)).ready()
        rover = running.enter_context(first.rover())
        wait_for_link(rover)
        assert rover.mode().troubles == []
        with DaemonProcess(second) as twin:
            twin.ready()
            both = (daemon, twin)
            wait_for(lambda: all("name_taken" in one.codes() for one in both), "each sees the other")
            time.sleep(0.5)
            assert [one.codes().count("name_taken") for one in both] == [1, 1]
            assert refusals(second) == {"name_taken"}
            assert app.main(["--connect", second.endpoint, "state"]) == 2
            assert "2 programs answer lrm/rover/info (boot id " in capsys.readouterr().err
            (trouble,) = rover.mode().troubles
            assert "another daemon on the network is named rover" in trouble, (
                "who was there before goes on with its own"
            )
        wait_for(lambda: rover.mode().troubles == [], "the other is gone")
        assert [event.code for event in rover.events() if event.code.startswith("name")] == ["name_taken", "name_free"]
        with rover.control("test"):
            arm_when_ready(rover, "given", HOME)


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaemonSetup]:
    made = DaemonSetup.make(tmp_path_factory.mktemp("daemon"), SLOW_BOARD)
    with BoardProcess(made), DaemonProcess(made) as daemon:
        daemon.ready()
        yield made


@pytest.mark.parametrize("complete", [False, True], ids=["one of two answers", "as the only whole answer"])
def test_no_reply_and_no_state_of_another_boot_id_is_accepted(setup: DaemonSetup, complete: bool) -> None:
    with setup.rover() as rover:
        known = rover.boot_id
        with forged(setup, "f" * 16, complete):
            found = accepted(rover)
        assert (found.ik, found.lease, found.mode, found.states, found.refused) == (0, 0, 0, 0, 0)
        assert rover.boot_id == known


@pytest.mark.parametrize("complete", [False, True], ids=["one of two answers", "as the only whole answer"])
def test_a_copied_boot_id_makes_every_reply_doubtful_and_none_accepted(setup: DaemonSetup, complete: bool) -> None:
    """States are taken for the daemon's: that only access control prevents."""
    with setup.rover() as rover:
        with forged(setup, rover.boot_id, complete):
            found = accepted(rover)
            with pytest.raises(SeveralDaemons, match="2 programs answer lrm/rover/state/mode"):
                rover.mode()
        assert (found.ik, found.lease, found.mode, found.refused) == (0, 0, 0, 3 * TRIES)
        assert found.states > 0
        assert rover.mode().mode == "disarmed"


def test_all_processes_of_the_daemon_answer_with_one_boot_id(setup: DaemonSetup) -> None:
    with setup.rover() as rover:
        known = rover.boot_id
        assert rover.fk(FkRequest(q_rad=[[0.0] * 6])).boot_id == known
        assert rover.mode().boot_id == known
        (wrong,) = rover._query_all("rpc/ik", b"\xc1", 5.0)
        assert unpack(ErrorReply, wrong.data).boot_id == known
        (stopped,) = rover._query_all("rpc/estop", b"", 5.0)
        assert unpack(Reply, stopped.data).boot_id == known


def test_a_restarted_daemon_ends_the_lease_and_its_states_go_on(tmp_path: Path) -> None:
    setup = DaemonSetup.make(tmp_path, SLOW_BOARD)
    seen: list[JointsState] = []
    with BoardProcess(setup), DaemonProcess(setup) as first, first.ready().setup.rover() as rover:
        before = rover.boot_id
        rover.watch(JointsState, "state/joints", seen.append)
        wait_for(lambda: bool(seen), "a state")
        with ExitStack() as running:
            with rover.control("test"):
                first.signal(signal.SIGKILL)
                first.process.wait(10)
                running.enter_context(DaemonProcess(setup)).ready()
                wait_for(lambda: seen[-1].boot_id != before, "states of the second")
                check_that_commands_are_refused(rover, before)
            wait_for_link(rover)
            with rover.control("test again"):
                rover.reset_fault()
                rover.arm("given", {"joint1": 0.0})
            assert rover.mode().mode == "armed"
            assert {state.boot_id for state in seen} == {before, rover.boot_id}


def check_that_commands_are_refused(rover: Rover, before: str) -> None:
    """Within the block of the lease that the daemon before gave; stops are carried out all the same."""
    now = rover.boot_id
    assert now != before
    with pytest.raises(DaemonRestarted, match=f"boot id {before}, now {now}") as restarted:
        rover.move({"joint1": 0.1})
    assert (restarted.value.before, restarted.value.now) == (before, now)
    with pytest.raises(DaemonRestarted):
        rover.jog({"joint1": 0.1})
    assert rover.mode().holder is None, "the lease was not acquired anew behind the client's back"
    rover.estop("test")
    wait_for(lambda: rover.mode().mode == "estop", "the new daemon was stopped")
