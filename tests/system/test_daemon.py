"""The daemon as it runs: three processes, a simulated board on a pty, zenoh on loopback, and all that can go wrong.

That nothing jumps and nothing is switched on unasked is proven, at the end of every test, by what the board was told.
"""

from __future__ import annotations

import itertools
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
import zenoh

from lrmd.client import MotionInterrupted, NoReply, RequestRefused
from lrmd.messages.codec import pack
from lrmd.messages.control import Event, JointsState, LeaseRequest, MoveRequest
from lrmd.messages.zenoh_session import client
from lrmd.persistence.state_file import load
from tests.support.daemon.daemon_harness import FAR, DaemonHarness, arm_when_ready, connected, running_harness
from tests.support.daemon.daemon_process import (
    LONGEST_LEASE,
    SECOND,
    SLOW_BOARD,
    START_TIMEOUT,
    BoardProcess,
    DaemonProcess,
    DaemonSetup,
    children,
    is_alive,
    role,
    running_daemon,
    wait_for,
)
from tests.support.daemon.pulse_invariants import read_frames
from tests.support.full_disk import full_disk, read_only


def in_order(wanted: list[str], found: list[str]) -> bool:
    """Whether the wanted words come in this order, with others between them or not."""
    rest = iter(found)
    return all(word in rest for word in wanted)


def test_it_boots_arms_moves_and_tells_of_it(harness: DaemonHarness) -> None:
    seen: list[JointsState] = []
    told: list[Event] = []
    harness.rover.watch(JointsState, "state/joints", seen.append)
    harness.rover.watch(Event, "event/**", told.append)
    assert harness.mode() == "disarmed"
    assert harness.pulses() == []
    with harness.rover.control("test"):
        harness.arm()
        harness.rover.move({"joint1": 0.1, "joint5": -0.05}, {"joint1": 0.05}, wait=False)
        modes = ["arming", "armed", "moving", "armed"]
        wait_for(lambda: [event.detail["mode"] for event in told if event.code == "mode"] == modes, "it is there")
    numbers = [state.seq for state in seen]  # before anything is asked: replies count too
    assert harness.rover.joints().q_rad[0] == pytest.approx(0.05, abs=1e-4)
    servo = harness.config.servos[0]
    true = harness.board.ask("status")["pulse_us"]
    assert isinstance(true, list)
    assert true[servo.channel] == pytest.approx(servo.pulse_ns(0.05) / 1000, abs=harness.config.clock.count_s * 1e6)
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    span = (seen[-1].t_mono_ns - seen[0].t_mono_ns) / SECOND
    assert 40 <= (len(seen) - 1) / span <= 55


def test_anybody_stops_everything_and_only_a_reset_and_arming_bring_it_back(harness: DaemonHarness) -> None:
    with harness.rover.control("test"), harness.setup.rover() as stranger:
        harness.under_way()
        stranger.estop("a stranger")
        wait_for(lambda: harness.pulses() == [], "the pulses stop")
        assert harness.mode() == "estop"
        with pytest.raises(RequestRefused, match="not allowed while estop"):
            harness.rover.move(FAR)
        wait_for(lambda: not any(harness.rover.joints().on), "the daemon knows")
        harness.rover.reset_fault()
        assert harness.mode() == "disarmed"
        with pytest.raises(RequestRefused):
            harness.rover.move(FAR)
        assert harness.pulses() == []
        assert any("a stranger" in event.text for event in harness.events())
    after = [line for line in read_frames(harness.setup.log) if line.event == "arm"]
    first_off = next(i for i in range(len(after) - 1, -1, -1) if after[i].pulsing) + 1
    assert not any(line.pulsing for line in after[first_off:])


def test_a_client_that_is_killed_leaves_an_arm_that_holds(harness: DaemonHarness) -> None:
    with harness.rover.control("test"):
        harness.arm()
    command = [
        str(Path(sys.executable).with_name("lrm")), "--connect", harness.setup.endpoint, "move", "--joint", "1", "85",
    ]  # fmt: skip
    mover = subprocess.Popen(command)
    harness.wait_until_moving()
    mover.kill()
    mover.wait()
    harness.wait_for_mode("holding")
    time.sleep(0.1)  # until the ramp and the board have it
    assert harness.stands_still()
    assert len(harness.pulses()) == 6
    assert in_order(["lease_lost", "mode"], harness.codes())
    assert harness.rover.mode().holder is None


def test_a_ramp_that_is_killed_on_the_way_takes_over_and_stands_still(tmp_path: Path) -> None:
    """The board waits for as long as a busy computer takes to start a process."""
    setup = DaemonSetup.make(tmp_path, SLOW_BOARD | LONGEST_LEASE)
    with running_harness(setup) as harness, harness.rover.control("test"):
        harness.arm()
        for _ in range(3):
            harness.rover.move({"joint1": 1.5}, wait=False)
            harness.wait_until_moving()
            os.kill(harness.daemon.child("ramp"), signal.SIGKILL)
            harness.wait_for_mode("holding")
            wait_for(lambda: harness.rover.mode().link == "ready", "the board answers")
            assert harness.stands_still()
            assert len(harness.pulses()) == 6
        harness.rover.move({"joint1": harness.joint1() - 0.02})
        assert harness.mode() == "armed"
        assert in_order(["ramp_died", "ramp_restarted"] * 3, harness.codes())
        assert harness.more("ramp_starts") == 3


def test_a_move_goes_on_when_the_ik_process_is_killed(harness: DaemonHarness) -> None:
    with harness.rover.control("test"):
        harness.arm()
        harness.rover.move({"joint1": 0.3}, wait=False)
        harness.wait_until_moving()
        os.kill(harness.daemon.child("ik"), signal.SIGKILL)
        wait_for(lambda: harness.more("ik_starts") == 1, "it is started anew")
        harness.wait_for_mode("armed")
    assert harness.joint1() == pytest.approx(0.3, abs=1e-3)
    assert harness.more("ramp_starts") == 0
    assert "ik_died" in harness.codes()


def test_a_daemon_that_is_killed_falls_silent_and_the_next_one_knows_where_the_arm_was(own: DaemonHarness) -> None:
    with own.rover.control("test"):
        own.under_way()
        wait_for(lambda: own.joint1() > 0.3, "some way is gone")
        there = own.joint1()
        processes = children(own.daemon.pid)
        assert len(processes) >= 2
        own.daemon.signal(signal.SIGKILL)
        wait_for(lambda: not any(map(is_alive, processes)), "its processes end with it")
        with suppress(NoReply):
            own.rover.joints()
    wait_for(lambda: own.pulses() == [], "the board stops by itself", 3.0)
    assert read_frames(own.setup.log)[-1].event == "silence"
    with connected(own.setup) as (_, rover):
        info = rover.info()
        assert rover.mode().mode == "disarmed"
        assert not info.stored_still
        assert info.stored_rad["joint1"] == pytest.approx(there, abs=0.3)
        with rover.control("test"), pytest.raises(RequestRefused, match="was moving when its pose was last stored"):
            arm_when_ready(rover, "stored")
        time.sleep(0.2)
        assert own.pulses() == []


@pytest.mark.parametrize("bears", [True, False])
def test_a_pose_that_was_left_standing_survives_a_kill_unless_it_fell(tmp_path: Path, bears: bool) -> None:
    """At home gravity's torque on joint 2 is 0.9 N m: whether its servo bears that is for the configuration to say."""
    setup = DaemonSetup.make(tmp_path, {"unpowered_nm = 0.05": "unpowered_nm = 1.0"} if bears else None)
    with running_harness(setup) as harness:
        _left_standing_and_killed(harness, bears)


def _left_standing_and_killed(harness: DaemonHarness, bears: bool) -> None:
    with harness.rover.control("test"):
        harness.arm()
        harness.rover.move({"joint1": 0.1})
    wait_for(lambda: (stored := load(harness.setup.state)) is not None and stored.still, "the pose is stored at rest")
    harness.daemon.signal(signal.SIGKILL)
    harness.daemon.process.wait()
    with connected(harness.setup) as (_, rover):
        if not bears:
            wait_for(lambda: harness.pulses() == [], "the board stops by itself", 3.0)
            assert not rover.info().stored_still
            with rover.control("test"), pytest.raises(RequestRefused, match="the arm fell"):
                arm_when_ready(rover, "stored")
            time.sleep(0.2)
            assert harness.pulses() == []
            return
        wait_for(lambda: harness.pulses() == [], "the board stops by itself", 3.0)
        time.sleep(0.1)
        assert rover.info().stored_still
        with rover.control("test"):
            harness.arm(rover, "stored")
            assert rover.joints().q_rad[0] == pytest.approx(0.1, abs=1e-3)


def test_a_new_daemon_takes_a_pulsing_board_over_without_a_step(tmp_path: Path) -> None:
    with running_harness(DaemonSetup.make(tmp_path, {"silence_ms = 1000": "silence_ms = 10000"})) as harness:
        with harness.rover.control("test"):
            harness.under_way()
        harness.daemon.signal(signal.SIGKILL)
        harness.daemon.process.wait()
        there = harness.pulses()
        with connected(harness.setup) as (_, rover), rover.control("test"):
            assert rover.mode().mode == "disarmed"
            arm_when_ready(rover, "board")
            assert rover.mode().mode == "armed"
            assert harness.pulses() == there
            assert harness.stands_still()


def test_a_killed_daemon_leaves_its_address_even_by_a_router_that_is_stopped(tmp_path: Path) -> None:
    with running_daemon(DaemonSetup.make(tmp_path)) as (_, daemon):
        os.kill(daemon.child("router"), signal.SIGSTOP)
        daemon.signal(signal.SIGKILL)
        daemon.process.wait()
        with connected(daemon.setup) as (_, rover):
            assert rover.mode().mode == "disarmed"


def test_a_daemon_waits_for_an_address_that_another_program_leaves_soon(tmp_path: Path) -> None:
    setup = DaemonSetup.make(tmp_path)
    with BoardProcess(setup), socket.create_server(("127.0.0.1", setup.port)) as other, DaemonProcess(setup) as daemon:
        threading.Timer(1.0, other.close).start()
        daemon.ready()


def test_a_stopped_ramp_is_replaced_before_the_arm_sags(harness: DaemonHarness) -> None:
    with harness.rover.control("test"):
        harness.under_way()
        stopped = harness.daemon.child("ramp")
        os.kill(stopped, signal.SIGSTOP)
        wait_for(lambda: not is_alive(stopped), "it is replaced")
        wait_for(lambda: harness.rover.mode().link == "ready", "the board answers")
        died = next(event.text for event in harness.events() if event.code == "ramp_died")
        assert float(re.findall(r"no tick for ([\d.]+) s", died)[0]) < 1.5, "500 ms, and what a busy computer adds"
        known = (("holding", True), ("fault", False))
        wait_for(lambda: (harness.mode(), bool(harness.pulses())) in known, "it holds, or is limp and known to be")
        assert harness.stands_still()


def test_a_stopped_api_freezes_the_arm_and_wakes_to_a_lost_lease(harness: DaemonHarness) -> None:
    with suppress(NoReply, RequestRefused), harness.rover.control("test"):
        harness.under_way()
        harness.daemon.signal(signal.SIGSTOP)
        time.sleep(1.0)
        still = harness.stands_still()
        harness.daemon.signal(signal.SIGCONT)
        assert still
    harness.wait_for_mode("holding")
    assert len(harness.pulses()) == 6
    assert harness.stands_still()
    assert {"api_silent", "lease_lost"} <= set(harness.codes())
    assert harness.more("ramp_starts") == 0


@pytest.mark.parametrize("seconds", [0.1, 1.5])
def test_a_board_that_stops_answering_is_a_fault(harness: DaemonHarness, seconds: float) -> None:
    with harness.rover.control("test"):
        harness.under_way()
        harness.board.signal(signal.SIGSTOP)
        harness.wait_for_mode("fault")
        time.sleep(seconds)
        harness.board.signal(signal.SIGCONT)
        wait_for(lambda: harness.rover.mode().link == "ready", "the board answers")
        assert harness.mode() == "fault"
        assert harness.stands_still()
        limp = not harness.pulses()
        assert limp == (seconds > 1.0)
        harness.rover.reset_fault()
        assert harness.mode() == ("disarmed" if limp else "holding")
        assert harness.stands_still()
    assert in_order(["link_down", "link_lost", "link_up"], harness.codes())


def test_an_unplugged_board_comes_back_and_stands_still(harness: DaemonHarness) -> None:
    with harness.rover.control("test"):
        harness.under_way()
        harness.board.ask("hangup 0.5")
        harness.wait_for_mode("fault")
        wait_for(lambda: harness.rover.mode().link == "ready", "the port is back")
        assert harness.mode() == "fault"
        assert harness.stands_still()
        assert len(harness.pulses()) == 6
        harness.rover.reset_fault()
        assert harness.mode() == "holding"
        there = harness.joint1()
        harness.rover.move({"joint1": there - 0.02})
    assert in_order(["link_down", "link_lost", "link_up"], harness.codes())
    assert harness.more("reconnects") == 1


@pytest.mark.parametrize(("lost", "code"), [("brownout 0.05", "board_restarted"), ("chiploss 0.1", "board_silenced")])
def test_a_power_loss_leaves_a_limp_arm_until_armed(harness: DaemonHarness, lost: str, code: str) -> None:
    with harness.rover.control("test"):
        harness.under_way()
        harness.board.ask(lost)
        harness.wait_for_mode("fault")
        wait_for(lambda: harness.rover.mode().link == "ready", "the board answers")
        time.sleep(0.2)
        assert harness.pulses() == []
        assert any(fault.code == code for fault in harness.rover.faults().faults)
        harness.rover.reset_fault()
        time.sleep(0.2)
        assert (harness.mode(), harness.pulses()) == ("disarmed", [])
        harness.arm()
        wait_for(lambda: len(harness.pulses()) == 6, "the board has switched all of them on")


SUBSCRIBER = """
import sys, threading, zenoh
from lrmd.messages.zenoh_session import client
with zenoh.open(client([sys.argv[1]])) as session:
    session.declare_subscriber("lrm/**", lambda sample: None)
    print("listening", flush=True)
    threading.Event().wait()
"""


def test_a_stalled_subscriber_holds_nobody_up(harness: DaemonHarness) -> None:
    command = [sys.executable, "-c", SUBSCRIBER, harness.setup.endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        try:
            assert other.stdout.readline() == "listening\n"
            other.send_signal(signal.SIGSTOP)
            came: list[int] = []
            harness.rover.watch(JointsState, "state/joints", lambda _: came.append(time.monotonic_ns()))
            with harness.rover.control("test"):
                harness.arm()
                harness.rover.move({"joint1": 0.3})
            assert harness.mode() == "armed"
            gaps = [b - a for a, b in itertools.pairwise(came)]
            assert len(came) > 50
            assert max(gaps) < SECOND // 2
        finally:
            other.kill()


LATE = """
import sys
from lrmd.client import MotionInterrupted, RequestRefused, Rover
import time
with Rover("test", [sys.argv[1]]) as rover, rover.control("late"):
    print("ready", flush=True)
    try:
        rover.move({"joint1": 1.5})
    except MotionInterrupted as error:
        print(error.why, flush=True)
    for _ in range(15):
        here = rover.joints().q_rad[0]
        try:
            rover.move({"joint1": here + 0.02})
            print("moved", flush=True)
            break
        except RequestRefused as error:
            last = error.code
            time.sleep(0.2)
    else:
        print(last, flush=True)
"""
"""A client that moves, and moves on when its lease has expired; says what came of it."""


@pytest.mark.parametrize("another", [False, True])
def test_a_late_client_goes_on_unless_another_had_the_lease(harness: DaemonHarness, another: bool) -> None:
    """Stopped for a second in the middle of a motion: the arm holds; nothing moves until the client asks again."""
    with harness.rover.control("test"):
        harness.arm()
    command = [sys.executable, "-c", LATE.replace('"test"', repr(harness.rover.robot)), harness.setup.endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as late:
        try:
            assert late.stdout.readline() == "ready\n"
            harness.wait_until_moving()
            late.send_signal(signal.SIGSTOP)
            wait_for(lambda: harness.mode() == "holding", "the arm holds")
            if another:
                with harness.rover.control("another"):
                    pass
            assert harness.stands_still(1.0)
            late.send_signal(signal.SIGCONT)
            assert late.stdout.readline() == "lease lost\n"
            assert late.stdout.readline() == ("lease\n" if another else "moved\n")
        finally:
            late.kill()


def test_a_full_disk_is_told_and_stops_nothing(tmp_path: Path) -> None:
    setup = DaemonSetup.make(tmp_path)
    with full_disk(setup.state) as make_room, running_harness(setup) as harness:
        with harness.rover.control("test"):
            harness.arm()
            harness.rover.move({"joint1": 0.05})
            assert "state_not_saved" in harness.codes()
            make_room()
            harness.rover.move({"joint1": 0.1})
            wait_for(lambda: "state_saved" in harness.codes(), "the state can be saved again")
        assert [path.name for path in setup.state.iterdir()] == ["state.json"]
        harness.daemon.signal(signal.SIGTERM)
        assert harness.daemon.process.wait(5) == 0


def test_where_the_stored_pose_cannot_be_taken_back_the_arm_does_not_leave_it(tmp_path: Path) -> None:
    """It would move, fall, and be armed at its old pose after a restart."""
    setup = DaemonSetup.make(tmp_path)
    with running_harness(setup) as harness, harness.rover.control("test"):
        harness.arm()
        wait_for(lambda: (stored := load(setup.state)) is not None and stored.still, "the pose is stored")
        before = harness.rover.joints().pulse_us
        with read_only(setup.state):
            for ask in (lambda: harness.rover.move({"joint1": 0.5}), lambda: harness.rover.carry(0.1)):
                with pytest.raises(
                    RequestRefused, match=r"state\.json: cannot be renamed \(.*make the folder writable"
                ):
                    ask()
            harness.rover.jog({"joint1": 0.5})
            wait_for(lambda: any("cmd/jog" in e.text for e in harness.rover.events()), "the jog is refused")
            assert harness.rover.joints().pulse_us == before
            harness.rover.relax()
            with pytest.raises(RequestRefused, match="cannot be renamed"):
                harness.arm()
        # The state is published on its own: the last one may be from before the reply.
        wait_for(lambda: harness.rover.joints().on == [False] * len(before), "the arm is limp")
        harness.arm()
        harness.rover.move({"joint1": 0.1})


def test_a_motion_takes_the_stored_pose_back_before_it_begins(tmp_path: Path) -> None:
    """Also where the disk becomes read-only at once: the arm falls, and is not armed at the old pose."""
    setup = DaemonSetup.make(tmp_path)
    with running_harness(setup) as harness, harness.rover.control("test"):
        harness.arm()
        wait_for(lambda: (stored := load(setup.state)) is not None and stored.still, "the pose is stored")
        harness.rover.move({"joint1": 0.8}, wait=False)
        with read_only(setup.state):
            time.sleep(0.3)
            harness.rover.estop()
            harness.daemon.process.kill()
            harness.daemon.process.wait(10.0)
    with running_harness(setup) as harness, harness.rover.control("test"), pytest.raises(RequestRefused, match="given"):
        arm_when_ready(harness.rover, "stored")


@pytest.mark.parametrize("content", ["", '{"schema": "lrm/state/1", "boots": "many"}', "\0" * 400])
def test_a_damaged_state_file_is_set_aside(tmp_path: Path, content: str) -> None:
    setup = DaemonSetup.make(tmp_path)
    setup.state.mkdir()
    (setup.state / "state.json").write_text(content, encoding="utf-8")
    with running_harness(setup) as harness:
        assert harness.mode() == "disarmed"
        assert harness.rover.info().stored_rad == {}
        assert [e.level for e in harness.rover.events() if e.code == "state_damaged"] == ["error"]
        with harness.rover.control("test"), pytest.raises(RequestRefused, match="no pose was stored"):
            arm_when_ready(harness.rover, "stored")
    assert (setup.state / "state.damaged").read_text(encoding="utf-8") == content


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"baud = 115200": "bauds = 115200"}, ["bauds", "baud"]),
        ({"silence_ms = 1000": "silence_ms = 0"}, ["silence_ms", "50"]),
        ({"[servo.joint3]\nchannel = 2": "[servo.joint3]\nchannel = 1"}, ["joint3", "channel 1"]),
    ],
)
def test_a_wrong_configuration_exits_with_2(tmp_path: Path, changes: dict[str, str], words: list[str]) -> None:
    setup = DaemonSetup.make(tmp_path, changes)
    command = [str(Path(sys.executable).with_name("lrmd")), "--config", str(setup.config)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert str(setup.config) in done.stderr
    assert all(word in done.stderr for word in words), done.stderr
    assert not setup.state.exists()


def test_a_zenoh_port_that_is_taken_is_said(harness: DaemonHarness, tmp_path: Path) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    other = DaemonSetup.make(folder)
    other.config.write_text(
        other.config.read_text(encoding="utf-8").replace(str(other.port), str(harness.setup.port)), encoding="utf-8"
    )
    with DaemonProcess(other) as daemon:
        assert daemon.process.wait(10) == 1
        line = daemon.log_entries()[-1]
        assert str(harness.setup.port) in str(line["text"])
        assert line["level"] == "error"
    assert harness.mode() == "disarmed"


def test_a_second_daemon_of_the_same_files_is_one_line_and_stores_no_pose(harness: DaemonHarness) -> None:
    command = [str(Path(sys.executable).with_name("lrmd")), "--config", str(harness.setup.config)]
    with harness.rover.control("test"):
        harness.arm()
        harness.rover.move({"joint1": 0.1})
        wait_for(lambda: (found := load(harness.setup.state)) is not None and found.still, "the pose is stored")
        before = load(harness.setup.state)
        second = subprocess.run(command, capture_output=True, text=True, timeout=20)
        assert (second.returncode, second.stderr.count("\n")) == (2, 1)
        assert f"{harness.setup.state}: is used by another lrmd" in second.stderr
        assert load(harness.setup.state) == before
        harness.rover.move({"joint1": 0.0})
    assert harness.mode() == "armed"


def test_a_second_daemon_on_the_same_port_touches_nothing(harness: DaemonHarness, tmp_path: Path) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    other = DaemonSetup.make(folder)
    other.config.write_text(
        other.config.read_text(encoding="utf-8").replace(str(other.link), str(harness.setup.link)), encoding="utf-8"
    )
    with harness.rover.control("test"):
        harness.arm()
        with DaemonProcess(other) as daemon:
            daemon.ready()
            with other.rover() as second, second.control("other"):
                with pytest.raises(RequestRefused, match="another program"):
                    second.arm("given", {"joint1": 1.0})
                harness.rover.move({"joint1": 0.1})
                assert second.mode().link == "closed"
            assert "port_refused" in daemon.codes()
    assert harness.mode() == "armed"
    assert harness.more("bad_frames") == 0


def test_systemd_hears_of_it_as_long_as_the_ramp_ticks(tmp_path: Path) -> None:
    setup = DaemonSetup.make(tmp_path)
    with BoardProcess(setup), DaemonProcess(setup, watchdog_s=0.2) as daemon:
        systemd = daemon.notifications
        daemon.ready()
        systemd.wait_for("WATCHDOG=1")
        assert systemd.messages[0][1].startswith("READY=1")
        time.sleep(1.0)
        assert len(systemd.times("WATCHDOG=1")) >= 5
        stopped = time.monotonic_ns()
        os.kill(daemon.child("ramp"), signal.SIGSTOP)
        wait_for(lambda: "ramp_died" in daemon.codes(), "the ramp is replaced")
        wait_for(
            lambda: bool(systemd.times("WATCHDOG=1", time.monotonic_ns() - SECOND // 5)), "there are signs of life"
        )
        wait_for(lambda: len(systemd.times("WATCHDOG=1", stopped + SECOND)) >= 2, "they go on")
        beats = systemd.times("WATCHDOG=1", stopped)
        assert max(b - a for a, b in itertools.pairwise(beats)) > SECOND // 10, "it was told of a ramp that stood still"
        daemon.signal(signal.SIGTERM)
        systemd.wait_for("STOPPING=1")
        assert daemon.process.wait(5) == 0


def test_a_systemd_that_does_not_listen_stops_nothing(tmp_path: Path) -> None:
    setup = DaemonSetup.make(tmp_path)
    with BoardProcess(setup), DaemonProcess(setup, watchdog_s=0.2) as daemon:
        daemon.ready()
        daemon.notifications.listening.clear()
        with setup.rover() as rover:
            came: list[JointsState] = []
            time.sleep(1.2)
            rover.watch(JointsState, "state/joints", came.append)
            wait_for(lambda: len(came) >= 10, "state flows on", 3.0)


def test_two_sigterms_at_once_end_it_on_the_way_and_nothing_is_lost(own: DaemonHarness) -> None:
    """The second one comes while the first one's handler has hardly run; a handler that did any work would be torn."""
    with own.rover.control("test"):
        own.under_way()
        processes = children(own.daemon.pid)
        own.daemon.signal(signal.SIGTERM)
        second = time.monotonic_ns() + 100_000
        while time.monotonic_ns() < second:
            pass
        own.daemon.signal(signal.SIGTERM)
        assert own.daemon.process.wait(5) == 0
    assert own.daemon.codes()[-1] == "stopped"
    assert own.daemon.notifications.times("STOPPING=1")
    wait_for(lambda: not any(map(is_alive, processes)), "its processes end with it")
    assert [path.name for path in own.setup.state.iterdir()] == ["state.json"]
    saved = load(own.setup.state)
    assert not saved.still, "it was moving"
    servo = own.config.servos[0]
    count = own.config.clock.count_s * 1e9
    told = [line.counts[servo.channel] for line in read_frames(own.setup.log) if line.pulsing][-1]
    assert saved.pulse_ns["joint1"] == pytest.approx(told * count, abs=count / 2 + 1), (
        "the last frame that the board got"
    )


def test_sigterms_in_every_moment_of_its_end_are_one(tmp_path: Path) -> None:
    """Up to the last: an interpreter that ends puts the default handlers back, which would kill it with a signal."""
    setup = DaemonSetup.make(tmp_path)
    with BoardProcess(setup), DaemonProcess(setup) as daemon:
        daemon.ready()
        while daemon.process.poll() is None:
            daemon.signal(signal.SIGTERM)
            time.sleep(0.0002)
        assert daemon.process.returncode == 0
        assert daemon.codes()[-1] == "stopped"
    assert load(setup.state) is not None


def test_a_ramp_that_dies_again_and_again_ends_the_daemon(tmp_path: Path) -> None:
    setup = DaemonSetup.make(tmp_path)
    with BoardProcess(setup), DaemonProcess(setup) as daemon:
        daemon.ready()

        def killed() -> bool:
            for pid in children(daemon.pid):
                if role(pid) == "ramp":
                    with suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGKILL)
            return daemon.process.poll() is not None

        wait_for(killed, "the daemon gives up", START_TIMEOUT, 0.05)
        assert daemon.process.returncode == 1
        assert daemon.codes()[-1] == "given_up"
        assert daemon.codes().count("ramp_died") >= 9, "and the last one"
        assert children(daemon.pid) == []


def test_messages_that_make_no_sense_change_nothing(harness: DaemonHarness) -> None:
    with zenoh.open(client([harness.setup.endpoint])) as session:
        for tail in ("cmd/target", "cmd/jog"):
            session.put(harness.setup.key(tail), b"\xc1 no message")
            session.put(harness.setup.key(tail), pack(MoveRequest(lease="none", waypoints=[{"joint1": 1.0}])))
        wait_for(lambda: harness.codes().count("refused") == 4, "each is told of")
        request = pack(LeaseRequest(action="acquire", holder="x"))
        replies = list(session.get(harness.setup.key("rpc/*"), payload=request, timeout=5.0))
        assert replies
        assert all(reply.err is not None for reply in replies)
    assert harness.mode() == "disarmed"
    assert harness.rover.mode().holder is None


def test_anybody_may_hold_and_the_mover_hears_of_it(harness: DaemonHarness) -> None:
    with harness.setup.rover() as stranger, harness.rover.control("test"):
        harness.arm()
        timer = threading.Timer(0.3, stranger.hold)
        timer.start()
        with pytest.raises(MotionInterrupted, match="holding"):
            harness.rover.move(FAR)
        timer.join()
        assert harness.stands_still()
