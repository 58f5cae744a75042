"""Our client and the daemon's identity: imitators on an open router, a daemon that is killed and started again."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from lrmd.client import DaemonRestarted, FkRequest, Rover, SeveralDaemons
from lrmd.messages.codec import ErrorReply, unpack
from lrmd.messages.control import JointsState, Reply
from tests.soak.hostile.forger import TRIES, accepted, forged
from tests.support.daemon.daemon_harness import wait_for_link
from tests.support.daemon.daemon_process import SLOW_BOARD, BoardProcess, DaemonProcess, DaemonSetup, wait_for


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
