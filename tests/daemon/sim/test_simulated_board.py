"""Simulated board: chip registers, effects of frames, silence timeout, fault injection, and its process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.servo_table import PwmClock
from lrm_math.errors import LrmError
from lrmd.config import load_config
from lrmd.link import pca9685, protocol
from lrmd.link.frames import Frame, FrameDecoder, FrameType, encode, word_count
from lrmd.link.pca9685 import ALL_OFF_H, AUTO_INCREMENT, LED0, MODE1, PRESCALE, RESTART, SLEEP
from lrmd.link.protocol import BoardStatus, ErrorCode
from lrmd.sim.board import SimulatedBoard
from lrmd.sim.faults import (
    BrownOut,
    ChipPowerLoss,
    ChipSilence,
    ClearFrameFaults,
    Fault,
    FrameFault,
    HangUp,
    LineStall,
    ScheduledFault,
    bit_flipped,
    doubled,
    lost,
    parse_fault,
)
from lrmd.sim.pca9685_chip import I2cNoAcknowledge, Pca9685Chip
from lrmd.sim.simulation import Simulation
from tests.support.sweep import examples

MS, SECOND = 1_000_000, 1_000_000_000
START = 500_000
"""ns that the chip's oscillator takes to start."""
counts = st.dictionaries(st.integers(0, 15), st.integers(0, 4095))


def running(oscillator_hz: float = 25e6, prescale: int = 121) -> Pca9685Chip:
    chip = Pca9685Chip(oscillator_hz)
    now = 0
    for step in pca9685.start_sequence(prescale):
        if isinstance(step, pca9685.BusPause):
            now += round(step.seconds * 1e9)
        else:
            chip.write(step.register, step.data, now)
    return chip


def widths(chip: Pca9685Chip) -> list[int | None]:
    return [chip.width(channel) for channel in range(16)]


def frames(data: bytes) -> list[Frame]:
    events = FrameDecoder().feed(data)
    assert all(isinstance(event, Frame) for event in events)
    return [event for event in events if isinstance(event, Frame)]


def say(board: SimulatedBoard | Simulation, frame: Frame, now: int = 0) -> Frame:
    (reply,) = frames(board.feed(encode(frame), now))
    return reply


def new_board(seed: int = 1) -> SimulatedBoard:
    return SimulatedBoard(Pca9685Chip(), Random(seed))


def set_up_board(seed: int = 1) -> SimulatedBoard:
    board = new_board(seed)
    protocol.ack_of(say(board, protocol.setup(0, 121, 1000)))
    return board


# The chip


@given(st.floats(30.0, 400.0), st.floats(23e6, 27e6), st.floats(0.1e-3, 2.4e-3))
def test_pulse_is_what_the_clock_of_the_same_oscillator_says(frequency: float, oscillator: float, pulse: float) -> None:
    clock = PwmClock(frequency, oscillator)
    count = int(clock.counts_of(pulse))
    chip = running(oscillator, clock.prescale)
    chip.write(LED0 + 4 * 3, pca9685.channel_bytes(count), SECOND)
    assert chip.pulse(3) == float(clock.pulse_of(count))


def test_pulses_of_another_oscillator_are_shorter_by_the_ratio() -> None:
    ours, theirs = running(25e6), running(25.3e6)
    for chip in (ours, theirs):
        chip.write(LED0, pca9685.channel_bytes(307), SECOND)
    a, b = ours.pulse(0), theirs.pulse(0)
    assert a / b == pytest.approx(25.3 / 25.0, rel=1e-12)


@given(st.integers(0, 255))
def test_prescale_is_taken_in_sleep_only(prescale: int) -> None:
    chip = running(prescale=100)
    chip.write(PRESCALE, bytes((prescale,)), SECOND)
    assert chip.read(PRESCALE) == bytes((100,))
    chip.write(MODE1, bytes((AUTO_INCREMENT | SLEEP,)), SECOND)
    chip.write(PRESCALE, bytes((prescale,)), SECOND)
    assert chip.read(PRESCALE)[0] == max(prescale, 3)


def test_power_on_is_as_the_data_sheet_says() -> None:
    chip = Pca9685Chip()
    assert (chip.read(MODE1)[0], chip.read(PRESCALE)[0], widths(chip)) == (0x11, 0x1E, [None] * 16)
    assert chip.read(LED0 + 3)[0] == 0x10


@given(st.integers(0, 15), st.integers(1, 4095), st.integers(1, 4095))
def test_one_transaction_never_shows_a_pulse_between(channel: int, before: int, after: int) -> None:
    chip = running()
    register = LED0 + 4 * channel
    chip.write(register, pca9685.channel_bytes(before), SECOND)
    chip.write(register, pca9685.channel_bytes(after), SECOND)
    assert chip.width(channel) == after
    chip.write(register, pca9685.channel_bytes(before), SECOND)
    seen = set()
    for offset, byte in enumerate(pca9685.channel_bytes(after)):
        chip.write(register + offset, bytes((byte,)), SECOND)
        seen.add(chip.width(channel))
    torn = before & 0xF00 | after & 0xFF or None
    assert seen == {before, torn, after}  # byte by byte, a servo may see a pulse that nobody asked for


def test_auto_increment_only_when_enabled_and_wraps_around() -> None:
    chip = Pca9685Chip()
    chip.write(LED0, b"\x01\x02\x03", 0)
    assert chip.read(LED0)[0] == 3
    chip.write(MODE1, bytes((AUTO_INCREMENT | SLEEP,)), 0)
    assert chip.read(0x45, 2)[1] == AUTO_INCREMENT | SLEEP
    chip.write(PRESCALE, bytes((50, AUTO_INCREMENT)), 0)
    assert (chip.read(PRESCALE)[0], chip.read(MODE1)[0]) == (50, AUTO_INCREMENT)


@pytest.mark.parametrize("register", [0x46, 0xF9, 0xFF])
def test_registers_that_do_not_exist_do_not_answer(register: int) -> None:
    with pytest.raises(I2cNoAcknowledge):
        Pca9685Chip().write(register, b"\0", 0)
    with pytest.raises(I2cNoAcknowledge):
        Pca9685Chip().read(register)


def test_full_off_overrides_everything_and_full_on_is_no_pulse() -> None:
    chip = running()
    chip.write(LED0, bytes((0, 0x10, 0, 0x11)), SECOND)
    assert chip.width(0) is None
    chip.write(LED0, bytes((0, 0x10, 0, 1)), SECOND)
    assert chip.width(0) is None
    chip.write(LED0, bytes((0, 0, 0, 1)), SECOND)
    assert chip.width(0) == 256
    chip.write(ALL_OFF_H, b"\x10", SECOND)
    assert widths(chip) == [None] * 16


@given(st.integers(0, 4095), st.integers(0, 4095))
def test_late_start_wraps_round_the_period(on: int, off: int) -> None:
    chip = running()
    chip.write(LED0, on.to_bytes(2, "little") + off.to_bytes(2, "little"), SECOND)
    assert chip.width(0) == ((off - on) % 4096 or None)


def test_channels_restart_only_on_command_and_not_before_the_oscillator_runs() -> None:
    chip = running()
    chip.write(LED0, pca9685.channel_bytes(300), SECOND)
    chip.write(MODE1, bytes((AUTO_INCREMENT | SLEEP,)), SECOND)
    assert chip.read(MODE1)[0] & RESTART
    assert chip.width(0) is None
    chip.write(MODE1, bytes((AUTO_INCREMENT,)), 2 * SECOND)
    chip.write(MODE1, bytes((AUTO_INCREMENT | RESTART,)), 2 * SECOND + START - 1)
    assert chip.width(0) is None
    chip.write(MODE1, bytes((AUTO_INCREMENT | RESTART,)), 2 * SECOND + START)
    assert chip.width(0) == 300
    assert not chip.read(MODE1)[0] & RESTART


# The board


@given(counts)
def test_outputs_are_what_was_armed_and_others_stay(wanted: dict[int, int]) -> None:
    board = set_up_board()
    before = {channel: 200 + channel for channel in range(16)}
    say(board, protocol.arm(1, before))
    reply = say(board, protocol.arm(2, wanted))
    assert reply.seq == 2
    expected = before | wanted
    assert protocol.state_of(say(board, protocol.read(3, range(16)))) == expected
    assert widths(board.chip) == [expected[channel] or None for channel in range(16)]
    assert bool(protocol.ack_of(reply).status & BoardStatus.PULSING) == any(expected.values())


@given(counts, counts)
def test_no_output_is_ever_anything_but_old_or_new(old: dict[int, int], new: dict[int, int]) -> None:
    board = set_up_board()
    say(board, protocol.arm(1, old))
    seen: list[list[int | None]] = []
    write = board.chip.write

    def watched(register: int, data: bytes, now: int) -> None:
        write(register, data, now)
        seen.append(widths(board.chip))

    board.chip.write = watched  # type: ignore[method-assign]
    say(board, protocol.arm(2, new))
    for outputs in seen:
        for channel, width in enumerate(outputs):
            assert width in (old.get(channel) or None, new.get(channel, old.get(channel)) or None)


strange = st.builds(
    lambda kind, seq, mask, words: Frame(kind, seq, mask, tuple(words[: word_count(kind, mask)])),
    st.sampled_from([*FrameType, 0, 0x55, 0xFF]),
    st.integers(0, 255),
    st.integers(0, 65535) | st.sampled_from([0, 1, 2, 3]),
    st.lists(st.integers(0, 65535) | st.sampled_from([0, 50, 121, 1000, 4095, 4096]), min_size=16, max_size=16),
)


@pytest.mark.slow
@given(st.lists(strange, max_size=12), st.booleans())
def test_a_refused_frame_has_had_no_effect(several: list[Frame], ready: bool) -> None:
    board = set_up_board() if ready else new_board()
    for number, frame in enumerate(several):
        before = board.chip.read(0, 1), widths(board.chip), board.silence_ms, board.status, board.accepted
        reply = say(board, frame, number)
        if reply.type == FrameType.ERROR:
            protocol.error_of(reply)
            assert (board.chip.read(0, 1), widths(board.chip), board.silence_ms, board.status, board.accepted) == before
        else:
            assert board.accepted == before[-1] + 1
        assert reply.seq == frame.seq


@pytest.mark.parametrize(
    ("frame", "code", "index"),
    [
        (Frame(0x55, 9, 0), ErrorCode.UNKNOWN_TYPE, None),
        (Frame(FrameType.ARM, 9, 0b1010, (5, 4096)), ErrorCode.VALUE, 3),
        (Frame(FrameType.SETUP, 9, 0b11, (2, 1000)), ErrorCode.VALUE, 0),
        (Frame(FrameType.SETUP, 9, 0b11, (121, 49)), ErrorCode.VALUE, 1),
        (Frame(FrameType.SETUP, 9, 0b100, (1,)), ErrorCode.VALUE, 2),
        (Frame(FrameType.HELLO, 9, 0b100), ErrorCode.VALUE, 2),
        (protocol.arm(9, {0: 300}), ErrorCode.NOT_SET_UP, None),
    ],
)
def test_error_codes_name_the_reason(frame: Frame, code: ErrorCode, index: int | None) -> None:
    refusal = protocol.error_of(say(new_board(), frame))
    assert (refusal.code, refusal.index) == (code, index)


def test_bad_bytes_are_answered_too() -> None:
    wire = bytearray(encode(protocol.hello(1)))
    wire[-2] ^= 1
    board = new_board()
    for data, code in [
        (bytes(wire), ErrorCode.CRC),
        (b"\x02\x07\0", ErrorCode.SHAPE),
        (b"\x07" * 60, ErrorCode.TOO_LONG),
    ]:
        (reply,) = frames(board.feed(data, 0))
        assert protocol.error_of(reply).code == code
        assert reply.seq == 0
    assert board.refused == 3


def test_the_same_prescale_goes_on_pulsing_and_another_one_stops_first() -> None:
    board = set_up_board()
    say(board, protocol.arm(1, {0: 300, 7: 400}))
    ack = protocol.ack_of(say(board, protocol.setup(2, 121, 2000)))
    assert ack.status == BoardStatus.PULSING | BoardStatus.SET_UP
    assert board.chip.width(7) == 400
    ack = protocol.ack_of(say(board, protocol.setup(3, 60, 2000)))
    assert ack.status == BoardStatus.SET_UP
    assert widths(board.chip) == [None] * 16
    assert protocol.state_of(say(board, protocol.read(4, [0, 7]))) == {0: 0, 7: 0}
    say(board, protocol.arm(5, {0: 300}))
    assert board.chip.width(0) == 300


@given(st.integers(50, 10_000))
def test_silence_stops_the_pulses_at_the_timeout_and_not_before(silence_ms: int) -> None:
    board = new_board()
    say(board, protocol.setup(0, 121, silence_ms))
    say(board, protocol.arm(1, {0: 300, 5: 310}), SECOND)
    due = SECOND + silence_ms * MS
    assert board.deadline == due
    for now in (due - 2, due - 1):  # talk that is not ARM does not count
        say(board, protocol.hello(2), now)
        assert board.chip.width(5) == 310
    board.tick(due)
    assert widths(board.chip) == [None] * 16
    assert board.deadline is None
    assert board.status == BoardStatus.SILENCED
    for counts in ({0: 0}, {0: 300}):  # latched: no ARM wakes a sagged arm
        assert protocol.error_of(say(board, protocol.arm(3, counts), due)).code == ErrorCode.NOT_SET_UP
    assert protocol.ack_of(say(board, protocol.setup(4, 121, silence_ms), due)).status == BoardStatus.SET_UP
    reply = say(board, protocol.arm(5, {0: 300}), due)
    assert protocol.ack_of(reply).status == BoardStatus.PULSING | BoardStatus.SET_UP


def test_a_late_frame_finds_the_pulses_stopped() -> None:
    board = set_up_board()
    say(board, protocol.arm(1, {0: 300, 1: 400}))
    assert protocol.state_of(say(board, protocol.read(2, [0, 1]), 2 * SECOND)) == {0: 0, 1: 0}


def test_info_reports_the_counters() -> None:
    board = set_up_board()
    say(board, protocol.arm(1, {0: 9999 % 4096}))
    say(board, Frame(0x55, 2, 0))
    info = protocol.info_of(say(board, protocol.hello(3)))
    assert (info.prescale, info.silence_ms, info.accepted, info.refused) == (121, 1000, 3, 1)
    assert info.simulated


def test_power_cycle_clears_the_state_and_changes_the_boot_number() -> None:
    board = set_up_board()
    say(board, protocol.arm(1, {0: 300}))
    boots = [board.boot]
    for now in range(1, 200):
        board.power_cycle(now)
        boots.append(board.boot)
        assert widths(board.chip) == [None] * 16
    assert all(a != b for a, b in pairwise(boots))
    assert min(boots) >= 1
    assert max(boots) <= 65535
    assert protocol.error_of(say(board, protocol.arm(2, {0: 300}))).code == ErrorCode.NOT_SET_UP


def test_unresponsive_chip_is_reported_and_the_outputs_stop() -> None:
    board = set_up_board()
    say(board, protocol.arm(1, {0: 300}))
    board.chip.answers = False
    for frame in (protocol.arm(2, {0: 310}), protocol.read(3, [0]), protocol.hello(4), protocol.setup(5, 60, 100)):
        assert protocol.error_of(say(board, frame)).code == ErrorCode.CHIP
    assert board.status & BoardStatus.CHIP_FAULT
    assert board.silence_ms == 1000
    board.tick(SECOND)  # the pin, not the bus
    assert board.chip.width(0) is None
    board.chip.answers = True
    board.tick(SECOND + 10 * MS)
    assert board.status == BoardStatus.SILENCED


def test_reset_chip_is_detected() -> None:
    board = set_up_board()
    board.chip.power_cycle()
    assert protocol.error_of(say(board, protocol.arm(1, {0: 300}))).code == ErrorCode.CHIP
    say(board, protocol.setup(2, 121, 1000))
    say(board, protocol.arm(3, {0: 300}))
    assert board.chip.width(0) == 300


# Faults


def with_faults(*faults: str, seed: int = 2) -> Simulation:
    return Simulation(set_up_board(), None, Random(seed), [parse_fault(text) for text in faults])


def test_no_flipped_bit_of_a_frame_ever_moves_the_arm_elsewhere() -> None:
    wire = encode(protocol.arm(1, {channel: 310 + channel for channel in range(9)}))
    for bit in range(8 * len(wire)):
        board = set_up_board()
        say(board, protocol.arm(0, {channel: 300 + channel for channel in range(9)}))
        corrupted = bytearray(wire)
        corrupted[bit // 8] ^= 1 << bit % 8
        board.feed(bytes(corrupted), 1)
        assert [board.chip.width(channel) for channel in range(9)] == [300 + channel for channel in range(9)]
        say(board, protocol.hello(2)) if bit // 8 < len(wire) - 1 else board.feed(b"\0", 1)
        assert protocol.ack_of(say(board, protocol.arm(3, {0: 321}))).status & BoardStatus.PULSING


@pytest.mark.parametrize(
    ("fault", "answers", "left"),
    [
        ("lose frame 2", [1, 0, 1], [301, None, 303]),
        ("double frame 2", [1, 2, 1], [301, 302, 303]),
        ("lose frame 2 out", [1, 0, 1], [301, 302, 303]),
        ("double frame 3 out", [1, 1, 2], [301, 302, 303]),
        ("lose 1", [0, 0, 0], [None, None, None]),
        ("double 1 both", [4, 4, 4], [301, 302, 303]),
    ],
)
def test_frames_are_lost_and_doubled_as_specified(fault: str, answers: list[int], left: list[int | None]) -> None:
    link = with_faults(fault)
    replies = [frames(link.feed(encode(protocol.arm(n, {n: 300 + n})), n)) for n in (1, 2, 3)]
    assert [len(several) for several in replies] == answers
    assert [link.board.chip.width(channel) for channel in (1, 2, 3)] == left


@pytest.mark.parametrize("kind", ["flip", "lose", "double"])
def test_fault_rates_hold_until_cleared(kind: str) -> None:
    link = with_faults(f"{kind} 0.2")
    odd = 0
    for n in range(2000):
        replies = link.feed(encode(protocol.arm(n % 256, {0: 300})), n)
        odd += [event.type for event in frames(replies)] != [FrameType.ACK]
    assert 320 < odd < 720
    link.begin(ClearFrameFaults(), 0)
    link.feed(b"\0", 0)
    for n in range(200):
        say(link, protocol.arm(n, {0: 300}))


def test_faults_repeat_with_their_seed() -> None:
    def course(seed: int) -> bytes:
        link = with_faults("flip 0.1", "lose 0.1 both", "double 0.1 out", seed=seed)
        return b"".join(link.feed(encode(protocol.arm(n, {0: 300 + n})), n) for n in range(200))

    assert course(1) == course(1) != course(2)


def test_a_stall_delivers_late_and_silence_has_stopped_the_pulses_meanwhile() -> None:
    link = with_faults("stall 2 at 1")
    say(link, protocol.arm(1, {0: 300}), SECOND - 1)
    assert link.feed(encode(protocol.hello(2)), SECOND) == b""
    assert link.feed(encode(protocol.arm(3, {1: 301})), SECOND + MS) == b""
    assert link.deadline == SECOND - 1 + SECOND
    assert link.tick(2 * SECOND) == b""
    assert link.board.chip.width(0) is None
    late = frames(link.tick(3 * SECOND))
    assert [(reply.type, reply.seq) for reply in late] == [(FrameType.INFO, 2), (FrameType.ERROR, 3)]
    assert link.board.chip.width(1) is None


def test_hang_up_removes_the_device_and_loses_bytes_in_transit() -> None:
    link = with_faults("hangup 0.5 at 1")
    say(link, protocol.arm(1, {0: 300}), SECOND - 1)
    boot = link.board.boot
    assert link.present
    assert link.feed(encode(protocol.arm(2, {0: 400})), SECOND) == b""
    assert not link.present
    assert link.deadline == SECOND + SECOND // 2
    link.tick(SECOND + SECOND // 2)
    assert link.present
    assert protocol.ack_of(say(link, protocol.arm(3, {1: 301}), 3 * SECOND // 2)).boot == boot
    assert link.board.chip.width(0) == 300


def test_a_brown_out_shows_in_the_boot_number() -> None:
    link = with_faults("brownout 0.2 at 1")
    boot = protocol.ack_of(say(link, protocol.arm(1, {0: 300}))).boot
    assert link.feed(encode(protocol.arm(2, {0: 300})), SECOND) == b""
    assert widths(link.board.chip) == [None] * 16
    after = say(link, protocol.arm(3, {0: 300}), SECOND + 200 * MS)
    assert protocol.error_of(after).code == ErrorCode.NOT_SET_UP
    info = protocol.info_of(say(link, protocol.hello(4), SECOND + 200 * MS))
    assert info.boot != boot
    assert info.status == BoardStatus(0)


def test_a_silent_chip_comes_back() -> None:
    link = with_faults("chip 0.1 at 1")
    say(link, protocol.arm(1, {0: 300}), SECOND - 1)
    assert protocol.error_of(say(link, protocol.arm(2, {0: 301}), SECOND)).code == ErrorCode.CHIP
    assert link.board.chip.width(0) == 300
    assert not protocol.ack_of(say(link, protocol.arm(3, {0: 302}), SECOND + 100 * MS)).status & BoardStatus.CHIP_FAULT
    assert link.board.chip.width(0) == 302


def test_a_chip_that_lost_its_power_needs_a_setup() -> None:
    link = with_faults("chiploss 0.1 at 1")
    boot = protocol.ack_of(say(link, protocol.arm(1, {0: 300}), SECOND - 1)).boot
    assert protocol.error_of(say(link, protocol.arm(2, {0: 301}), SECOND)).code == ErrorCode.CHIP
    assert protocol.error_of(say(link, protocol.arm(3, {0: 302}), SECOND + 100 * MS)).code == ErrorCode.CHIP
    assert widths(link.board.chip) == [None] * 16
    assert protocol.ack_of(say(link, protocol.setup(4, 121, 500), SECOND + 101 * MS)).boot == boot


FAULTS: list[tuple[str, Fault]] = [
    ("flip 0.01", FrameFault(bit_flipped, 0.01)),
    ("lose frame 7 both", FrameFault(lost, frame=7, direction="both")),
    ("double 1 out", FrameFault(doubled, 1.0, direction="out")),
    ("stall 0.5", LineStall(0.5)),
    ("hangup 2", HangUp(2.0)),
    ("brownout 0", BrownOut(0.0)),
    ("chip 1", ChipSilence(1.0)),
    ("chiploss 1", ChipPowerLoss(1.0)),
    ("calm", ClearFrameFaults()),
]


@pytest.mark.parametrize(("text", "fault"), FAULTS)
def test_faults_parse_to_their_values(text: str, fault: Fault) -> None:
    assert parse_fault(text) == ScheduledFault(fault)
    assert parse_fault(f"{text} at 2.5") == ScheduledFault(fault, 2.5)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "empty"),
        ("stal 3", "stall"),
        ("stall", "SECONDS"),
        ("stall x", "number"),
        ("stall -1", "number"),
        ("stall nan", "number"),
        ("flip 2", "rate"),
        ("flip 0.1 up", "in, out, both"),
        ("lose frame 1.5", "number"),
        ("stall 1 at x", "number"),
    ],
)
def test_invalid_fault_names_the_valid_syntax(text: str, word: str) -> None:
    with pytest.raises(LrmError, match=word):
        parse_fault(text)


@pytest.mark.slow
@given(st.binary(max_size=300), st.lists(st.integers(0, 300), max_size=5))
@examples(100, 200)
def test_any_bytes_in_any_chunks_are_handled(data: bytes, cuts: list[int]) -> None:
    link = with_faults("flip 0.2 both", "double 0.2 both", "lose 0.2 both")
    edges = [0, *sorted(cuts), len(data)]
    for a, b in pairwise(edges):
        link.feed(data[a:b], 0)
    link.begin(ClearFrameFaults(), 0)
    link.feed(b"\0\0", 0)
    assert protocol.info_of(say(link, protocol.hello(1))).simulated


PROGRAM = """
import os, signal, sys
from lrmd.config import load_config
from lrmd.sim.launch import simulated_board
from pathlib import Path
with simulated_board(load_config(Path(sys.argv[1]))) as config:
    print(config.link.port, config.state, flush=True)
    signal.pause()
"""


@pytest.mark.long
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGINT])
def test_the_board_ends_with_its_daemon(end: signal.Signals, tmp_path: Path) -> None:
    config = Path(__file__).resolve().parents[3] / "config" / "lrmd.toml"
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-c", PROGRAM, str(config)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment
    ) as own:
        port, state = map(Path, own.stdout.readline().split())
        assert port.is_symlink()
        assert state == load_config(config).state / "simulated", "the real arm's pose is not that of a simulated one"
        own.send_signal(end)
        own.wait()
    until = time.monotonic() + 10.0
    while port.is_symlink() and time.monotonic() < until:
        time.sleep(0.02)
    assert not port.is_symlink()
