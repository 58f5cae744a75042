"""`lrmd-board` as a process: a real pty, real time, a real serial port on the other side."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import serial

from lrmd.link import protocol
from lrmd.link.frames import Frame, FrameDecoder, FrameType, encode
from lrmd.link.protocol import BoardStatus
from lrmd.sim.control_socket import ControlError, control_path, query_board
from tests.support.sweep import in_soak

COMMAND = [sys.executable, "-m", "lrmd.sim.process"]
Start = Callable[..., "subprocess.Popen[str]"]
TRUTH = """\
schema = "lrm/model/1"
arm = "lrm-rover"
effects = ["compliance@joint2"]
[parameters]
"compliance.joint2.k_rad_per_Nm" = 0.1
"""


class Host:
    """The other side of the cable."""

    def __init__(self, link: Path) -> None:
        self.port = serial.Serial(str(link), 115_200, timeout=2.0, write_timeout=2.0, exclusive=True)
        self.decoder = FrameDecoder()

    def say(self, frame: Frame) -> Frame:
        self.port.write(encode(frame))
        events = self.decoder.feed(self.port.read_until(b"\0"))
        assert len(events) == 1, events
        assert isinstance(events[0], Frame)
        return events[0]

    def close(self) -> None:
        self.port.close()


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "board"


@pytest.fixture
def start(link: Path) -> Iterator[Start]:
    running: list[subprocess.Popen[str]] = []

    def begin(*options: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [*COMMAND, "--link", str(link), *options], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        running.append(process)
        assert str(link) in process.stdout.readline()
        return process

    yield begin
    for process in running:
        process.kill()
        process.communicate(timeout=10)


def wait_for(what: Callable[[], bool], seconds: float = 5.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def lines(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_thousands_of_frames_are_all_acknowledged_in_order(start: Start, link: Path, tmp_path: Path) -> None:
    log, count = tmp_path / "log.csv", 10_000 if in_soak() else 2_000
    start("--log", str(log))
    host = Host(link)
    protocol.ack_of(host.say(protocol.setup(0, 121, 1000)))
    for n in range(count):
        reply = host.say(protocol.arm(n % 256, dict.fromkeys(range(9), 300 + n % 7)))
        assert reply.seq == n % 256
        assert protocol.ack_of(reply).status == BoardStatus.PULSING | BoardStatus.SET_UP
    info = protocol.info_of(host.say(protocol.hello(1)))
    assert (info.accepted, info.refused) == (count + 2, 0)
    assert info.simulated
    arms = [line for line in lines(log) if line["event"] == "arm"]
    assert [int(line["ch8"]) for line in arms] == [300 + n % 7 for n in range(count)]
    times = [int(line["t_ns"]) for line in arms]
    assert times == sorted(times)
    assert {line["ch9"] for line in arms} == {""}


def test_nothing_is_echoed_and_nothing_is_said_unasked(start: Start, link: Path) -> None:
    start()
    descriptor = os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    os.write(descriptor, b"\x03\x0d\x0a\x04\x11\x13\x1a")  # what a cooked terminal would echo, or act on
    time.sleep(0.2)
    with pytest.raises(BlockingIOError):
        os.read(descriptor, 100)
    os.write(descriptor, b"\0" + encode(protocol.hello(7)))
    wait_for(lambda: bool(query_board(link, "status")["accepted"]))
    events = FrameDecoder().feed(os.read(descriptor, 1000))
    os.close(descriptor)
    assert [event.type for event in events if isinstance(event, Frame)] == [FrameType.ERROR, FrameType.INFO]


def test_hosts_come_and_go(start: Start, link: Path) -> None:
    start()
    boots = set()
    for _ in range(5):
        host = Host(link)
        boots.add(protocol.info_of(host.say(protocol.hello(1))).boot)
        host.close()
    assert len(boots) == 1


def test_a_hang_up_is_seen_and_the_link_leads_to_the_new_device(start: Start, link: Path) -> None:
    start()
    host = Host(link)
    protocol.ack_of(host.say(protocol.setup(0, 121, 10_000)))
    protocol.ack_of(host.say(protocol.arm(1, {0: 300})))
    boot = protocol.info_of(host.say(protocol.hello(2))).boot
    query_board(link, "hangup 0.2")
    wait_for(lambda: not link.is_symlink())
    with pytest.raises(serial.SerialException):
        host.port.read(1)
    wait_for(link.exists)
    again = Host(link)
    info = protocol.info_of(again.say(protocol.hello(3)))
    assert info.boot == boot
    assert protocol.state_of(again.say(protocol.read(4, [0]))) == {0: 300}
    host.close()


def test_a_brown_out_asked_for_while_it_runs(start: Start, link: Path) -> None:
    start()
    host = Host(link)
    boot = protocol.ack_of(host.say(protocol.setup(0, 121, 1000))).boot
    query_board(link, "brownout 0")
    wait_for(lambda: query_board(link, "status")["boot"] != boot)
    assert protocol.info_of(host.say(protocol.hello(1))).status == BoardStatus(0)


def test_silence_by_a_clock_that_runs_faster(start: Start, link: Path, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    start("--log", str(log), "--speed", "20")
    host = Host(link)
    host.say(protocol.setup(0, 121, 5000))
    host.say(protocol.arm(1, {0: 300}))
    before = float(str(query_board(link, "status")["t_s"]))
    time.sleep(0.1)
    assert float(str(query_board(link, "status")["t_s"])) - before >= 2.0
    wait_for(lambda: lines(log)[-1]["event"] == "silence")
    arm, silence = (int(line["t_ns"]) for line in lines(log)[-2:])
    assert silence - arm >= 5_000_000_000
    assert host.say(protocol.hello(2)).words[2] & BoardStatus.SILENCED


def test_a_host_that_never_reads_does_not_stop_the_board(start: Start, link: Path) -> None:
    start()
    descriptor = os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    wire = encode(protocol.hello(1))
    sent = 0
    while sent < 3000:
        try:
            os.write(descriptor, wire)
            sent += 1
        except BlockingIOError:
            time.sleep(0.001)
    wait_for(lambda: query_board(link, "status")["accepted"] == sent)
    os.close(descriptor)


def test_the_true_arm_follows_and_can_be_measured(start: Start, link: Path, tmp_path: Path) -> None:
    truth = tmp_path / "truth.toml"
    truth.write_text(TRUTH, encoding="utf-8")
    start("--truth", str(truth), "--channels", "joint1=4,joint2=5,joint3=6,joint4=7,joint5=8,joint6=9", "--speed", "5")
    host = Host(link)
    host.say(protocol.setup(0, 121, 10_000))
    host.say(protocol.arm(1, {channel: 400 if channel == 5 else 310 for channel in range(4, 10)}))
    wait_for(lambda: not query_board(link, "tcp")["moving"])
    joints, before = query_board(link, "joints"), query_board(link, "tcp")
    assert str(joints["joint2"]) != str(joints["joint1"])
    query_board(link, "payload 200")
    after = query_board(link, "measure")
    assert float(str(after["z_mm"])) < float(str(before["z_mm"])) - 3.0
    assert after["payload_g"] == 200.0


def test_ends_cleanly_by_time_and_by_signal(start: Start, link: Path) -> None:
    assert start("--seconds", "0.1").wait(10) == 0
    assert not link.is_symlink()
    assert not control_path(link).exists()
    for number in (signal.SIGTERM, signal.SIGINT):
        process = start()
        process.send_signal(number)
        assert process.wait(10) == 0
        assert not link.is_symlink()


def test_a_killed_board_leaves_nothing_in_the_way(start: Start, link: Path) -> None:
    process = start()
    process.kill()
    process.wait(10)
    with pytest.raises(ControlError, match="no simulated board"):
        query_board(link, "tcp")
    start()
    assert protocol.info_of(Host(link).say(protocol.hello(1))).simulated


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--fault", "stal 1"], "stall"),
        (["--arm", "lrm-moon"], "lrm-rover"),
        (["--truth", "nowhere.toml"], "nowhere.toml"),
        (["--channels", "joint1=16"], "0 to 15"),
        (["--speed", "0"], "--speed"),
        (["--start-deg", "1,x"], "number"),
        (["--osc-hz", "50"], "--osc-hz"),
        (["--nonsense"], "--help"),
        (["--ask", "tcp"], "no simulated board"),
    ],
)
def test_wrong_command_lines_are_one_line_and_code_2(link: Path, options: list[str], word: str) -> None:
    done = subprocess.run([*COMMAND, "--link", str(link), *options], capture_output=True, text=True, timeout=20)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert word in done.stderr
    assert list(link.parent.iterdir()) == []


def test_two_boards_do_not_share_a_link_and_files_are_not_replaced(start: Start, link: Path) -> None:
    start()
    done = subprocess.run([*COMMAND, "--link", str(link)], capture_output=True, text=True, timeout=20)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "another simulated board" in done.stderr
    other = link.with_name("file")
    other.write_text("mine", encoding="utf-8")
    done = subprocess.run([*COMMAND, "--link", str(other)], capture_output=True, text=True, timeout=20)
    assert done.returncode == 2
    assert other.read_text(encoding="utf-8") == "mine"
    with pytest.raises(ControlError, match="unknown question"):
        query_board(link, "weather")
