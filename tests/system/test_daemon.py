"""The daemon as it runs: three processes, a simulated board on a pty, zenoh on loopback, and all that can go wrong.

That nothing jumps and nothing is switched on unasked is proven, at the end of every test, by what the board was told.
"""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Literal

import pytest
import zenoh

from lrmd.client.rover import Interrupted, NoAnswer, RequestRefused, Rover
from lrmd.config import load_config
from lrmd.messages.control import Event, JointsState, LeaseRequest, MoveRequest, pack
from lrmd.messages.zenoh_session import client
from lrmd.persistence.state_file import load
from tests.support.daemon_process import (
    SECOND,
    BoardProcess,
    DaemonProcess,
    Place,
    children,
    is_alive,
    wait_for,
)
from tests.support.frame_laws import laws, read_frames

HOME = {f"joint{i}": 0.0 for i in range(1, 7)}
FAR = {"joint1": 1.5}
"""Half a minute away from `HOME`."""


class Rig:
    """A board, a daemon and a client; remembers when servos were asked to be switched on."""

    def __init__(self, place: Place, board: BoardProcess, daemon: DaemonProcess, rover: Rover) -> None:
        self.place, self.board, self.daemon, self.rover = place, board, daemon, rover
        self.config = load_config(place.config)
        self._board_started = board.started_at()
        self._asked: list[int] = []

    def arm(self, rover: Rover | None = None, where: Literal["given", "stored"] = "given") -> None:
        self._asked.append(time.monotonic_ns())
        (rover or self.rover).arm(where, HOME if where == "given" else None)

    def under_way(self) -> None:
        """Armed, and on a long move: frames with changing pulses go to the board."""
        self.arm()
        self.rover.move(FAR, wait=False)
        self.wait_until_moving()

    def wait_until_moving(self, rad: float = 0.02) -> None:
        start = self.joint1()
        wait_for(lambda: abs(self.joint1() - start) > rad, "joint 1 moves")

    def joint1(self) -> float:
        return self.rover.joints().q_rad[0]

    def mode(self) -> str:
        return self.rover.mode().mode

    def wait_for_mode(self, mode: str) -> None:
        wait_for(lambda: self.mode() == mode, f"the mode is {mode}")

    def codes(self) -> list[str]:
        return [event.code for event in self.rover.events()]

    def modes(self) -> list[str]:
        return [str(event.detail["mode"]) for event in self.rover.events() if event.code == "mode"]

    def pulses(self) -> list[float]:
        """What the board puts out, us."""
        pulses = self.board.ask("status")["pulse_us"]
        assert isinstance(pulses, list)
        return [pulse for pulse in pulses if pulse is not None]

    def stands_still(self, seconds: float = 0.3) -> bool:
        """Whether the board puts out the same pulses for a while."""
        before = self.pulses()
        time.sleep(seconds)
        return self.pulses() == before

    def check_laws(self) -> None:
        found = laws(self.config, read_frames(self.place.log))
        found.check([asked - self._board_started for asked in self._asked])


@contextmanager
def connected(place: Place) -> Iterator[tuple[DaemonProcess, Rover]]:
    """A daemon that has its board, and a client of it."""
    with DaemonProcess(place) as daemon:
        daemon.ready()
        with place.rover() as rover:
            wait_for(lambda: rover.mode().link == "ready", "the board answers")
            yield daemon, rover


@contextmanager
def rig_at(place: Place) -> Iterator[Rig]:
    with BoardProcess(place) as board, connected(place) as (daemon, rover):
        rig = Rig(place, board, daemon, rover)
        yield rig
        rig.check_laws()


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    with rig_at(Place.make(tmp_path)) as rig:
        yield rig


def in_order(wanted: list[str], found: list[str]) -> bool:
    """Whether the wanted words come in this order, with others between them or not."""
    rest = iter(found)
    return all(word in rest for word in wanted)


def test_it_boots_arms_moves_and_tells_of_it(rig: Rig) -> None:
    seen: list[JointsState] = []
    told: list[Event] = []
    rig.rover.watch(JointsState, "state/joints", seen.append)
    rig.rover.watch(Event, "event/**", told.append)
    assert rig.mode() == "disarmed"
    assert rig.pulses() == []
    with rig.rover.control("test"):
        rig.arm()
        rig.rover.move({"joint1": 0.1, "joint5": -0.05}, {"joint1": 0.05})
    numbers = [state.seq for state in seen]  # before anything is asked: replies count too
    assert rig.rover.joints().q_rad[0] == pytest.approx(0.05, abs=1e-4)
    servo = rig.config.servos[0]
    true = rig.board.ask("status")["pulse_us"]
    assert isinstance(true, list)
    assert true[servo.channel] == pytest.approx(servo.pulse_ns(0.05) / 1000, abs=rig.config.clock.count_s * 1e6)
    assert [event.detail["mode"] for event in told if event.code == "mode"] == ["arming", "armed", "moving", "armed"]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    span = (seen[-1].t_mono_ns - seen[0].t_mono_ns) / SECOND
    assert 40 <= (len(seen) - 1) / span <= 55


def test_anybody_stops_everything_and_only_a_reset_and_arming_bring_it_back(rig: Rig) -> None:
    with rig.rover.control("test"), rig.place.rover() as stranger:
        rig.under_way()
        stranger.estop("a stranger")
        wait_for(lambda: rig.pulses() == [], "the pulses stop")
        assert rig.mode() == "estop"
        with pytest.raises(RequestRefused, match="not allowed while estop"):
            rig.rover.move(FAR)
        wait_for(lambda: not any(rig.rover.joints().on), "the daemon knows")
        rig.rover.reset_fault()
        assert rig.mode() == "disarmed"
        with pytest.raises(RequestRefused):
            rig.rover.move(FAR)
        assert rig.pulses() == []
        assert any("a stranger" in event.text for event in rig.rover.events())
    after = [line for line in read_frames(rig.place.log) if line.event == "arm"]
    first_off = next(i for i in range(len(after) - 1, -1, -1) if after[i].pulsing) + 1
    assert not any(line.pulsing for line in after[first_off:])


def test_a_client_that_is_killed_leaves_an_arm_that_holds(rig: Rig) -> None:
    with rig.rover.control("test"):
        rig.arm()
    command = [
        str(Path(sys.executable).with_name("lrm")),
        "--connect",
        rig.place.endpoint,
        "move",
        "--joint",
        "1",
        "85",
    ]
    mover = subprocess.Popen(command)
    rig.wait_until_moving()
    mover.kill()
    mover.wait()
    rig.wait_for_mode("holding")
    assert rig.stands_still()
    assert len(rig.pulses()) == 6
    assert in_order(["lease_lost", "mode"], rig.codes())
    assert rig.rover.mode().holder is None


def test_a_ramp_that_is_killed_on_the_way_takes_over_and_stands_still(rig: Rig) -> None:
    with rig.rover.control("test"):
        rig.arm()
        for _ in range(3):
            rig.rover.move({"joint1": 1.5}, wait=False)
            rig.wait_until_moving()
            os.kill(rig.daemon.child("ramp"), signal.SIGKILL)
            rig.wait_for_mode("holding")
            wait_for(lambda: rig.rover.mode().link == "ready", "the board answers")
            assert rig.stands_still()
            assert len(rig.pulses()) == 6
        rig.rover.move({"joint1": rig.joint1() - 0.02})
        assert rig.mode() == "armed"
    assert in_order(["ramp_died", "ramp_restarted"] * 3, rig.codes())
    assert rig.rover.metrics().ramp_starts == 4


def test_a_move_goes_on_when_the_ik_process_is_killed(rig: Rig) -> None:
    with rig.rover.control("test"):
        rig.arm()
        rig.rover.move({"joint1": 0.3}, wait=False)
        rig.wait_until_moving()
        os.kill(rig.daemon.child("ik"), signal.SIGKILL)
        wait_for(lambda: rig.rover.metrics().ik_starts == 2, "it is started anew")
        rig.wait_for_mode("armed")
    assert rig.joint1() == pytest.approx(0.3, abs=1e-3)
    assert rig.rover.metrics().ramp_starts == 1
    assert "ik_died" in rig.codes()


def test_a_daemon_that_is_killed_falls_silent_and_the_next_one_knows_where_the_arm_was(rig: Rig) -> None:
    with rig.rover.control("test"):
        rig.under_way()
        wait_for(lambda: rig.joint1() > 0.3, "some way is gone")
        there = rig.joint1()
        own = children(rig.daemon.pid)
        assert len(own) >= 2
        rig.daemon.signal(signal.SIGKILL)
        wait_for(lambda: not any(map(is_alive, own)), "its processes end with it")
        with suppress(NoAnswer):
            rig.rover.joints()
    wait_for(lambda: rig.pulses() == [], "the board stops by itself", 3.0)
    assert read_frames(rig.place.log)[-1].event == "silence"
    with connected(rig.place) as (_, rover):
        info = rover.info()
        assert rover.mode().mode == "disarmed"
        assert not info.stored_still
        assert info.stored_rad["joint1"] == pytest.approx(there, abs=0.3)
        with rover.control("test"), pytest.raises(RequestRefused, match="was moving when its pose was last stored"):
            rover.arm("stored")
        time.sleep(0.2)
        assert rig.pulses() == []


def test_a_pose_that_was_left_standing_survives_a_kill(rig: Rig) -> None:
    with rig.rover.control("test"):
        rig.arm()
        rig.rover.move({"joint1": 0.1})
    rig.daemon.signal(signal.SIGKILL)
    rig.daemon.process.wait()
    with connected(rig.place) as (_, rover):
        wait_for(lambda: rig.pulses() == [], "the board stops by itself", 3.0)
        time.sleep(0.1)
        assert rover.info().stored_still
        with rover.control("test"):
            rig.arm(rover, "stored")
            assert rover.joints().q_rad[0] == pytest.approx(0.1, abs=1e-3)


def test_a_new_daemon_takes_a_pulsing_board_over_without_a_step(tmp_path: Path) -> None:
    with rig_at(Place.make(tmp_path, {"silence_ms = 1000": "silence_ms = 10000"})) as rig:
        with rig.rover.control("test"):
            rig.under_way()
        rig.daemon.signal(signal.SIGKILL)
        rig.daemon.process.wait()
        there = rig.pulses()
        with connected(rig.place) as (_, rover), rover.control("test"):
            assert rover.mode().mode == "disarmed"
            rover.arm("board")
            assert rover.mode().mode == "armed"
            assert rig.pulses() == there
            assert rig.stands_still()


def test_a_stopped_ramp_is_replaced_before_the_arm_sags(rig: Rig) -> None:
    with rig.rover.control("test"):
        rig.under_way()
        stopped = rig.daemon.child("ramp")
        os.kill(stopped, signal.SIGSTOP)
        time.sleep(1.5)
        assert not is_alive(stopped)
        wait_for(lambda: rig.rover.mode().link == "ready", "the board answers")
        assert "ramp_died" in rig.codes()
        if rig.pulses():
            assert rig.mode() == "holding"
            assert rig.stands_still()
        else:
            assert rig.mode() == "fault"


def test_a_stopped_api_freezes_the_arm_and_wakes_to_a_lost_lease(rig: Rig) -> None:
    with suppress(NoAnswer, RequestRefused), rig.rover.control("test"):
        rig.under_way()
        rig.daemon.signal(signal.SIGSTOP)
        time.sleep(1.0)
        still = rig.stands_still()
        rig.daemon.signal(signal.SIGCONT)
        assert still
    rig.wait_for_mode("holding")
    assert len(rig.pulses()) == 6
    assert rig.stands_still()
    assert {"api_silent", "lease_lost"} <= set(rig.codes())
    assert rig.rover.metrics().ramp_starts == 1


@pytest.mark.parametrize("seconds", [0.4, 1.5])
def test_a_board_that_stops_answering_is_a_fault(rig: Rig, seconds: float) -> None:
    with rig.rover.control("test"):
        rig.under_way()
        rig.board.signal(signal.SIGSTOP)
        rig.wait_for_mode("fault")
        time.sleep(seconds)
        rig.board.signal(signal.SIGCONT)
        wait_for(lambda: rig.rover.mode().link == "ready", "the board answers")
        assert rig.mode() == "fault"
        assert rig.stands_still()
        limp = not rig.pulses()
        assert limp == (seconds > 1.0)
        rig.rover.reset_fault()
        assert rig.mode() == ("disarmed" if limp else "holding")
        assert rig.stands_still()
    assert in_order(["link_down", "link_lost", "link_up"], rig.codes())


def test_an_unplugged_board_comes_back_and_stands_still(rig: Rig) -> None:
    with rig.rover.control("test"):
        rig.under_way()
        rig.board.ask("hangup 0.5")
        rig.wait_for_mode("fault")
        wait_for(lambda: rig.rover.mode().link == "ready", "the port is back")
        assert rig.mode() == "fault"
        assert rig.stands_still()
        assert len(rig.pulses()) == 6
        rig.rover.reset_fault()
        assert rig.mode() == "holding"
        there = rig.joint1()
        rig.rover.move({"joint1": there - 0.02})
    assert in_order(["link_down", "link_lost", "link_up"], rig.codes())
    assert rig.rover.metrics().reconnects == 2


def test_a_brown_out_leaves_a_limp_arm_until_it_is_armed(rig: Rig) -> None:
    with rig.rover.control("test"):
        rig.under_way()
        rig.board.ask("brownout 0.05")
        rig.wait_for_mode("fault")
        wait_for(lambda: rig.rover.mode().link == "ready", "the board answers")
        time.sleep(0.2)
        assert rig.pulses() == []
        assert any(fault.code == "board_restarted" for fault in rig.rover.faults().faults)
        rig.rover.reset_fault()
        time.sleep(0.2)
        assert (rig.mode(), rig.pulses()) == ("disarmed", [])
        rig.arm()
        assert len(rig.pulses()) == 6


SUBSCRIBER = """
import sys, threading, zenoh
from lrmd.messages.zenoh_session import client
with zenoh.open(client([sys.argv[1]])) as session:
    session.declare_subscriber("lrm/**", lambda sample: None)
    print("listening", flush=True)
    threading.Event().wait()
"""


def test_a_stalled_subscriber_holds_nobody_up(rig: Rig) -> None:
    command = [sys.executable, "-c", SUBSCRIBER, rig.place.endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        try:
            assert other.stdout is not None
            assert other.stdout.readline() == "listening\n"
            other.send_signal(signal.SIGSTOP)
            came: list[int] = []
            rig.rover.watch(JointsState, "state/joints", lambda _: came.append(time.monotonic_ns()))
            with rig.rover.control("test"):
                rig.arm()
                rig.rover.move({"joint1": 0.3})
            assert rig.mode() == "armed"
            gaps = [b - a for a, b in itertools.pairwise(came)]
            assert len(came) > 50
            assert max(gaps) < SECOND // 2
        finally:
            other.kill()


@contextmanager
def full_disk(folder: Path) -> Iterator[Callable[[], None]]:
    """A folder that nothing more fits into; gives what makes room. A tiny file system, or no right to write."""
    folder.mkdir()
    if os.geteuid() != 0:
        folder.chmod(0o500)
        yield lambda: folder.chmod(0o700)
        folder.chmod(0o700)
        return
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8k", "tmpfs", str(folder)], capture_output=True)
    if mounted.returncode:
        pytest.skip("mounting a small file system is not allowed here")
    try:
        filler = folder / "filler"
        with suppress(OSError):
            filler.write_bytes(b"x" * 100_000)
        yield filler.unlink
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_is_told_and_stops_nothing(tmp_path: Path) -> None:
    place = Place.make(tmp_path)
    with full_disk(place.state) as make_room, rig_at(place) as rig:
        with rig.rover.control("test"):
            rig.arm()
            rig.rover.move({"joint1": 0.05})
            assert "state_not_saved" in rig.codes()
            make_room()
            rig.rover.move({"joint1": 0.1})
            wait_for(lambda: "state_saved" in rig.codes(), "the state can be saved again")
        assert [path.name for path in place.state.iterdir()] == ["state.json"]
        rig.daemon.signal(signal.SIGTERM)
        assert rig.daemon.process.wait(5) == 0


@pytest.mark.parametrize("content", ["", '{"schema": "lrm/state/1", "boots": "many"}', "\0" * 400])
def test_a_damaged_state_file_is_set_aside(tmp_path: Path, content: str) -> None:
    place = Place.make(tmp_path)
    place.state.mkdir()
    (place.state / "state.json").write_text(content, encoding="utf-8")
    with rig_at(place) as rig:
        assert rig.mode() == "disarmed"
        assert rig.rover.info().stored_rad == {}
        assert [e.level for e in rig.rover.events() if e.code == "state_damaged"] == ["error"]
        with rig.rover.control("test"), pytest.raises(RequestRefused, match="no pose was stored"):
            rig.rover.arm("stored")
    assert (place.state / "state.damaged").read_text(encoding="utf-8") == content


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"baud = 115200": "bauds = 115200"}, ["bauds", "baud"]),
        ({"silence_ms = 1000": "silence_ms = 0"}, ["silence_ms", "50"]),
        ({"[servo.joint3]\nchannel = 2": "[servo.joint3]\nchannel = 1"}, ["joint3", "channel 1"]),
    ],
)
def test_a_wrong_configuration_is_one_line_and_code_2(
    tmp_path: Path, changes: dict[str, str], words: list[str]
) -> None:
    place = Place.make(tmp_path, changes)
    command = [str(Path(sys.executable).with_name("lrmd")), "--config", str(place.config)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert str(place.config) in done.stderr
    assert all(word in done.stderr for word in words), done.stderr
    assert not place.state.exists()


def test_a_zenoh_port_that_is_taken_is_said(rig: Rig, tmp_path: Path) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    other = Place.make(folder)
    other.config.write_text(
        other.config.read_text(encoding="utf-8").replace(str(other.port), str(rig.place.port)), encoding="utf-8"
    )
    with DaemonProcess(other) as daemon:
        assert daemon.process.wait(10) == 1
        line = daemon.said()[-1]
        assert str(rig.place.port) in str(line["text"])
        assert line["level"] == "error"
    assert rig.mode() == "disarmed"


def test_a_second_daemon_on_the_same_port_touches_nothing(rig: Rig, tmp_path: Path) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    other = Place.make(folder)
    other.config.write_text(
        other.config.read_text(encoding="utf-8").replace(str(other.link), str(rig.place.link)), encoding="utf-8"
    )
    with rig.rover.control("test"):
        rig.arm()
        with DaemonProcess(other) as daemon:
            daemon.ready()
            with other.rover() as second, second.control("other"):
                with pytest.raises(RequestRefused, match="another program"):
                    second.arm("given", {"joint1": 1.0})
                rig.rover.move({"joint1": 0.1})
                assert second.mode().link == "closed"
            assert "port_refused" in daemon.codes()
    assert rig.mode() == "armed"
    assert rig.rover.metrics().bad_frames == 0


def test_systemd_hears_of_it_as_long_as_the_ramp_ticks(tmp_path: Path) -> None:
    place = Place.make(tmp_path)
    with BoardProcess(place), DaemonProcess(place, watchdog_s=0.2) as daemon:
        systemd = daemon.notifications
        daemon.ready()
        systemd.wait_for("WATCHDOG=1")
        assert systemd.came[0][1].startswith("READY=1")
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
    place = Place.make(tmp_path)
    with BoardProcess(place), DaemonProcess(place, watchdog_s=0.2) as daemon:
        daemon.ready()
        daemon.notifications.listening.clear()
        with place.rover() as rover:
            came: list[JointsState] = []
            time.sleep(1.2)
            rover.watch(JointsState, "state/joints", came.append)
            wait_for(lambda: len(came) >= 10, "state flows on", 3.0)


def test_two_sigterms_at_once_end_it_on_the_way_and_nothing_is_lost(rig: Rig) -> None:
    """The second one comes while the first one's handler has hardly run; a handler that did any work would be torn."""
    with rig.rover.control("test"):
        rig.under_way()
        own = children(rig.daemon.pid)
        rig.daemon.signal(signal.SIGTERM)
        second = time.monotonic_ns() + 100_000
        while time.monotonic_ns() < second:
            pass
        rig.daemon.signal(signal.SIGTERM)
        assert rig.daemon.process.wait(5) == 0
    assert rig.daemon.codes()[-1] == "stopped"
    assert rig.daemon.notifications.times("STOPPING=1")
    wait_for(lambda: not any(map(is_alive, own)), "its processes end with it")
    assert [path.name for path in rig.place.state.iterdir()] == ["state.json"]
    saved = load(rig.place.state)
    assert saved is not None
    assert not saved.still, "it was moving"
    servo = rig.config.servos[0]
    count = rig.config.clock.count_s * 1e9
    told = [line.counts[servo.channel] for line in read_frames(rig.place.log) if line.pulsing][-1]
    assert saved.pulse_ns["joint1"] == pytest.approx(told * count, abs=count / 2 + 1), (
        "the last frame that the board got"
    )


def test_sigterms_in_every_moment_of_its_end_are_one(tmp_path: Path) -> None:
    """Up to the last: an interpreter that ends puts the default handlers back, which would kill it with a signal."""
    place = Place.make(tmp_path)
    with BoardProcess(place), DaemonProcess(place) as daemon:
        daemon.ready()
        while daemon.process.poll() is None:
            daemon.signal(signal.SIGTERM)
            time.sleep(0.0002)
        assert daemon.process.returncode == 0
        assert daemon.codes()[-1] == "stopped"
    assert load(place.state) is not None


def test_a_ramp_that_dies_again_and_again_ends_the_daemon(tmp_path: Path) -> None:
    place = Place.make(tmp_path)
    with BoardProcess(place), DaemonProcess(place) as daemon:
        daemon.ready()
        for _ in range(10):
            os.kill(daemon.child("ramp"), signal.SIGKILL)
            time.sleep(0.05)
        assert daemon.process.wait(5) == 1
        assert daemon.codes()[-1] == "given_up"
        assert children(daemon.pid) == []


def test_messages_that_make_no_sense_change_nothing(rig: Rig) -> None:
    with zenoh.open(client([rig.place.endpoint])) as session:
        for tail in ("cmd/target", "cmd/jog"):
            session.put(rig.place.key(tail), b"\xc1 no message")
            session.put(rig.place.key(tail), pack(MoveRequest(lease="none", waypoints=[{"joint1": 1.0}])))
        wait_for(lambda: rig.codes().count("refused") == 4, "each is told of")
        request = pack(LeaseRequest(action="acquire", holder="x"))
        replies = list(session.get(rig.place.key("rpc/*"), payload=request, timeout=5.0))
        assert replies
        assert all(reply.err is not None for reply in replies)
    assert rig.mode() == "disarmed"
    assert rig.rover.mode().holder is None


def test_anybody_may_hold_and_the_mover_hears_of_it(rig: Rig) -> None:
    with rig.place.rover() as stranger, rig.rover.control("test"):
        rig.arm()
        timer = threading.Timer(0.3, stranger.hold)
        timer.start()
        with pytest.raises(Interrupted, match="holding"):
            rig.rover.move(FAR)
        timer.join()
        assert rig.stands_still()
