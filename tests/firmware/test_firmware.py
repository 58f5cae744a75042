"""The firmware on a computer: follows the specification, agrees with the simulated board, and stops pulses."""

from __future__ import annotations

import json
import random
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.link import pca9685, protocol
from lrmd.link.frames import BadFrame, BadFrameReason, Frame, FrameDecoder, FrameType, bits_of, encode, word_count
from lrmd.link.protocol import BoardStatus, ErrorCode
from lrmd.sim.board import SIMULATED, SimulatedBoard
from lrmd.sim.pca9685_chip import Pca9685Chip
from tests.soak.fuzz_link import damaged, random_frame, random_string
from tests.support.daemon.firmware_board import BOOT, FIRMWARE, MS, FakeI2cBus, FirmwareBoard, firmware_module

DOCUMENT = FIRMWARE.parent / "docs" / "protocol.md"
ERRORS = {BadFrameReason.COBS: 1, BadFrameReason.LENGTH: 1, BadFrameReason.CRC: 2, BadFrameReason.TOO_LONG: 7}


def frames_of(text: bytes) -> list[Any]:
    """Frames by the host's decoder, said as the firmware says it."""
    events = FrameDecoder().feed(text)
    return [ERRORS[e.reason] if isinstance(e, BadFrame) else (e.type, e.seq, e.mask, e.words) for e in events]


@dataclass(frozen=True)
class TranscriptLine:
    """One line of the session in the document."""

    who: str
    says: str
    frame: bytes
    wire: bytes


def session() -> list[TranscriptLine]:
    rows = re.findall(
        r"^\| (host|board|wait) \| (.*?) \| (.*?) \| (.*?) *\|$", DOCUMENT.read_text("utf-8"), re.MULTILINE
    )
    return [TranscriptLine(who, says, *(bytes.fromhex(c.strip("`– ")) for c in cells)) for who, says, *cells in rows]


def test_the_document_shows_frames_as_they_are() -> None:
    lines = [line for line in session() if line.says.startswith("`")]
    assert len(lines) >= 15
    for line in lines:
        name, seq, mask, *words = line.says.strip("`").split()
        frame = Frame(FrameType[name], int(seq), int(mask, 16), tuple(map(int, words)))
        assert encode(frame) == line.wire
        assert firmware_module("link").encode(frame.type, frame.seq, frame.mask, frame.words) == line.wire
    for line in session():
        if line.wire:
            assert firmware_module("link").cobs_decode(line.wire[:-1]) == line.frame


def test_the_firmware_plays_the_session_of_the_document() -> None:
    board, answers = FirmwareBoard(), b""
    for line in session():
        if line.who == "host":
            answers += board.logic.receive(line.wire)
        elif line.who == "wait":
            board.wait(int(line.says.split()[0]))
        else:
            assert answers == line.wire, line.says
            answers = b""
    assert not board.bus.pulses


def test_the_simulated_board_plays_it_too() -> None:
    board, now, answers = SimulatedBoard(Pca9685Chip(), random.Random(0)), 0, b""
    board.boot = BOOT
    for line in session():
        if line.who == "host":
            answers += board.feed(line.wire, now)
        elif line.who == "wait":
            now += int(line.says.split()[0]) * MS
        else:
            (wanted,) = FrameDecoder().feed(line.wire)
            if isinstance(wanted, Frame) and wanted.type == FrameType.INFO:
                wanted = replace(wanted, words=(*wanted.words[:-1], SIMULATED))
            assert FrameDecoder().feed(answers) == [wanted]
            answers = b""


def test_both_sides_decode_alike() -> None:
    rng = random.Random(7)
    wires = [encode(random_frame(rng)) for _ in range(300)]
    for _ in range(6000):
        text = random_string(rng, wires)
        assert firmware_module("link").Decoder().feed(text) == frames_of(text), text.hex()


@given(st.binary(max_size=200), st.integers(1, 50))
def test_decoding_is_independent_of_chunking(text: bytes, size: int) -> None:
    decoder, events = firmware_module("link").Decoder(), []
    for at in range(0, len(text), size):
        events += decoder.feed(text[at : at + size])
    assert events == frames_of(text)


def host_frame(rng: random.Random) -> Frame:
    """Frames that a host may send, with a number out of range now and then."""
    seq, mask = rng.randrange(256), rng.randrange(1, 1 << 16) & rng.randrange(1 << 16)
    counts = {bit: rng.choice((0, rng.randrange(4096), rng.randrange(4096))) for bit in bits_of(mask)}
    draw = rng.random()
    if draw < 0.5:
        return protocol.arm(seq, counts)
    if draw < 0.65:
        return protocol.setup(seq, rng.choice((30, 121, 255)), rng.choice((50, 500, 1000)))
    if draw < 0.75:
        return protocol.read(seq, counts)
    if draw < 0.8:
        return protocol.hello(seq)
    kind = rng.choice((1, 2, 2, 3, 4, rng.randrange(256)))
    mask = rng.choice((0, 1, 2, 3, 4, 7, 0xFFFF))
    words = (rng.choice((0, 2, 3, 49, 50, 255, 256, 4095, 4096, 10_001, 65_535)) for _ in range(16))
    return Frame(kind, seq, mask, tuple(words)[: word_count(kind, mask)])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_the_firmware_does_what_the_simulated_board_does(seed: int) -> None:
    rng = random.Random(seed)
    ours = FirmwareBoard(kind=1)
    theirs = SimulatedBoard(Pca9685Chip(), random.Random(seed), now=0)
    ours.logic.boot = theirs.boot
    set_up = False
    for _ in range(400):
        text = b"".join(encode(host_frame(rng)) for _ in range(rng.choice((1, 1, 2))))
        if rng.random() < 0.15:
            text = damaged(text, rng)
        if rng.random() < 0.05:
            ours.bus.chip.answers = theirs.chip.answers = not theirs.chip.answers
        ours.wait(rng.choice((1, 7, 7, 40, 300, 1200)))
        theirs.tick(ours.bus.now)
        answer = ours.logic.receive(text)
        pieces = re.findall(rb"[^\0]*\0|[^\0]+", text)
        assert answer == b"".join(theirs.feed(piece, ours.bus.now) for piece in pieces), text.hex()
        ours.wait(0)
        theirs.tick(ours.bus.now)
        set_up |= bool(theirs.status & BoardStatus.SET_UP)
        assert registers(ours.bus.chip, set_up) == registers(theirs.chip, set_up)
        assert ours.bus.enabled == theirs.chip.enabled


def registers(chip: Pca9685Chip, set_up: bool) -> bytes:
    """Registers as both boards promise them: the channels and the prescale, the modes once set up."""
    answers, chip.answers = chip.answers, True
    out = b"".join(chip.read(pca9685.LED0 + n) for n in range(64)) + chip.read(pca9685.PRESCALE)
    if set_up:
        out += chip.read(pca9685.MODE1) + chip.read(pca9685.MODE2)
    chip.answers = answers
    return out


@pytest.mark.slow
@given(st.integers(50, 10_000), st.lists(st.integers(1, 400), max_size=30), st.data())
def test_pulses_stop_when_arm_frames_stop_whatever_else_comes(
    silence_ms: int, pauses: list[int], data: st.DataObject
) -> None:
    board = FirmwareBoard().set_up(silence_ms)
    board.ask(protocol.arm(2, {0: 307, 8: 400}))
    quiet = 0
    for pause in pauses:
        board.wait(pause)
        quiet += pause
        assert bool(board.bus.pulses) == (quiet < silence_ms)
        other = data.draw(st.sampled_from([protocol.hello(3), protocol.read(4, [0]), protocol.arm(5, {16 - 1: 0})]))
        if other.type == FrameType.ARM:
            other, quiet = (other, 0) if quiet < silence_ms else (protocol.hello(6), quiet)
        board.ask(other)
    board.wait(silence_ms)
    assert not board.bus.pulses
    assert not board.bus.enabled
    assert protocol.info_of(board.ask(protocol.hello(7))).status == BoardStatus.SILENCED


def test_silence_is_latched_until_a_setup() -> None:
    board = FirmwareBoard().set_up()
    board.ask(protocol.arm(2, {0: 307}))
    board.wait(1000)
    assert protocol.error_of(board.ask(protocol.arm(3, {0: 307}))).code == ErrorCode.NOT_SET_UP
    assert not board.bus.pulses
    assert protocol.ack_of(board.ask(protocol.setup(4, 121, 1000))).status == BoardStatus.SET_UP
    assert protocol.ack_of(board.ask(protocol.arm(5, {1: 300}))).status == BoardStatus.SET_UP | BoardStatus.PULSING
    assert board.bus.pulses == {1: 300}
    assert board.bus.enabled


def test_the_same_prescale_lets_a_pulsing_board_pulse_on() -> None:
    board = FirmwareBoard().set_up()
    board.ask(protocol.arm(2, {0: 307}))
    board.ask(protocol.setup(3, 121, 500))
    assert board.bus.pulses == {0: 307}
    board.ask(protocol.setup(4, 30, 500))
    assert board.bus.pulses == {}


def test_restarted_processor_stops_earlier_pulses() -> None:
    board = FirmwareBoard().set_up()
    board.ask(protocol.arm(2, dict.fromkeys(range(16), 307)))
    assert len(board.bus.pulses) == 16
    firmware_module("board").Board(board.bus, BOOT + 1)
    assert not board.bus.pulses
    assert not board.bus.enabled


def test_a_chip_that_is_dead_at_power_on_is_stopped_once_it_answers() -> None:
    bus = FakeI2cBus()
    for step in pca9685.start_sequence(121) + pca9685.channel_writes({3: 300}):
        bus.pause_us(1000) if isinstance(step, pca9685.BusPause) else bus.write(step.register, step.data)
    bus.chip.answers = False
    logic = firmware_module("board").Board(bus, BOOT)
    assert logic.status == BoardStatus.PULSING | BoardStatus.CHIP_FAULT
    bus.chip.answers = True
    assert bus.pulses == {3: 300}
    logic.tick(1)
    assert bus.pulses == {}
    assert logic.status == 0


def test_failed_stop_is_retried_and_arm_refused_before() -> None:
    board = FirmwareBoard().set_up()
    board.ask(protocol.arm(2, {0: 307}))
    board.bus.chip.answers = False
    board.wait(1000)
    assert not board.bus.enabled
    assert protocol.error_of(board.ask(protocol.arm(3, {1: 300}))).code is ErrorCode.CHIP
    assert not board.bus.enabled
    board.bus.chip.answers = True
    board.wait(1)
    assert not board.bus.pulses


def test_no_arm_revives_what_was_due_to_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    board = FirmwareBoard().set_up()
    board.ask(protocol.arm(2, {0: 307}))
    write, failing = board.bus.write, iter((True, True))

    def loose_contact(register: int, data: bytes) -> None:
        if next(failing, False):
            raise OSError(5)
        write(register, data)

    monkeypatch.setattr(board.bus, "write", loose_contact)
    board.wait(1000)
    assert protocol.error_of(board.ask(protocol.arm(3, {1: 300}))).code is ErrorCode.CHIP
    assert not board.bus.enabled
    assert protocol.error_of(board.ask(protocol.arm(4, {1: 300}))).code is ErrorCode.NOT_SET_UP
    assert not board.bus.pulses


@pytest.mark.parametrize("writes", [0, 1, 2])
def test_bus_failure_within_a_frame_is_reported_and_ends_in_silence(writes: int) -> None:
    board = FirmwareBoard().set_up()
    board.bus.writes_left = writes
    assert protocol.error_of(board.ask(protocol.arm(2, {0: 307, 4: 300, 9: 290}))).code is ErrorCode.CHIP
    board.bus.writes_left = None
    board.bus.chip.answers = True
    assert len(board.bus.pulses) == writes
    board.wait(1000)
    assert not board.bus.pulses


def test_reset_chip_is_reported_and_set_up_again() -> None:
    board = FirmwareBoard().set_up()
    board.ask(protocol.arm(2, {0: 307}))
    board.bus.chip.power_cycle()
    for frame in (protocol.arm(3, {0: 307}), protocol.read(4, [0])):
        assert protocol.error_of(board.ask(frame)).code is ErrorCode.CHIP
    assert not board.bus.pulses
    assert protocol.ack_of(board.ask(protocol.setup(5, 121, 1000))).status == BoardStatus.SET_UP
    board.ask(protocol.arm(6, {0: 308}))
    assert board.bus.pulses == {0: 308}


@given(st.lists(st.binary(max_size=60), max_size=20))
def test_noise_switches_nothing_on(texts: list[bytes]) -> None:
    board = FirmwareBoard().set_up()
    for text in texts:
        board.logic.receive(text)
    assert not board.bus.pulses


VECTORS = """
import json, sys
sys.path.insert(0, {path!r})
import board, link
texts = json.loads({texts!r})
out = []
for text in texts:
    text = bytes(text)
    out.append([list(e[:3]) + [list(e[3])] if isinstance(e, tuple) else e for e in link.Decoder().feed(text)])
class Chip:
    def __init__(self):
        self.registers = bytearray(256)
    def write(self, register, data):
        self.registers[register:register + len(data)] = data
    def read(self, register, length):
        return bytes(self.registers[register:register + length])
    def enable(self, on):
        pass
    def pause_us(self, us):
        pass
chip = Chip()
it = board.Board(chip, 14972)
for text in texts:
    out.append(list(it.receive(bytes(text))))
    it.tick(7)
    out.append(list(chip.registers))
print(json.dumps(out))
"""


def test_micropython_runs_it_to_the_same_bytes() -> None:
    interpreter = shutil.which("micropython")
    if interpreter is None:
        pytest.skip("no micropython on this machine")
    rng = random.Random(3)
    frames = [protocol.setup(1, 121, 1000), *(host_frame(rng) for _ in range(80))]
    wires = [encode(frame) for frame in frames]
    texts = json.dumps([list(text) for text in wires + [damaged(rng.choice(wires), rng) for _ in range(80)]])
    script = VECTORS.format(path=str(FIRMWARE), texts=texts)
    runs = [
        subprocess.run([who, "-c", script], capture_output=True, text=True) for who in (interpreter, sys.executable)
    ]
    assert runs[0].returncode == 0, runs[0].stderr
    assert json.loads(runs[0].stdout) == json.loads(runs[1].stdout)


@pytest.mark.parametrize("file", sorted(FIRMWARE.glob("*.py")), ids=lambda file: file.name)
def test_micropython_compiles_it(file: Path, tmp_path: Path) -> None:
    compiler = shutil.which("mpy-cross")
    if compiler is None:
        pytest.skip("no mpy-cross on this machine")
    run = subprocess.run([compiler, "-o", str(tmp_path / "out.mpy"), str(file)], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
