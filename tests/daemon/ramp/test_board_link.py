"""Which replies of the board count: only the answer to a frame that waits for one, once. Read from the bytes."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from itertools import pairwise, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.config import Config
from lrmd.link import protocol
from lrmd.link.frames import Frame, FrameDecoder, FrameType, encode
from lrmd.link.protocol import BoardStatus
from lrmd.ramp.board_link import NUMBERS, TABLE, Action, BoardLink, BoardReply
from lrmd.ramp.shared_memory import LinkState, RampFault
from tests.support.daemon.ramp_with_board import MIDDLE, TICK, RampWithBoard
from tests.support.sweep import examples

ALIVE = BoardStatus.PULSING | BoardStatus.SET_UP


def frames(wire: bytes) -> list[Frame]:
    return [event for event in FrameDecoder().feed(wire) if isinstance(event, Frame)]


def lost(line: RampWithBoard, config: Config) -> None:
    """The board is not heard until the link is lost, then the next two INFOs are let through."""
    for _ in range(config.reply // TICK + 3):
        line.back = b""
        line.tick()
    assert line.ramp.link is LinkState.GREETING
    line.tick()
    line.tick()
    assert line.ramp.link is LinkState.READING


def moving(config: Config) -> RampWithBoard:
    line = RampWithBoard(config).ready()
    line.tick(line.order())
    return line


def count(line: RampWithBoard) -> int:
    """Pulse count of the first servo, out of the board."""
    return frames(line.board.feed(encode(protocol.read(200, [0])), line.now))[0].words[0]


@pytest.mark.long
def test_a_state_of_an_old_handshake_is_not_adopted(config: Config) -> None:
    line = moving(config)
    lost(line, config)
    old = line.back
    assert [f.type for f in frames(old)] == [FrameType.STATE]
    line.tick()
    order = line.order(2, target=(MIDDLE + 480_000,) * 16)
    for _ in range(500):
        line.tick(replace(order, heartbeat=line.now))
    there = count(line)
    assert there - frames(old)[0].words[0] > 90
    for later in whatever_its_number(line):
        lost(later, config)
        sent = []
        for _ in range(6):
            later.back = old + later.back
            later.tick()
            sent += [f.word_by_bit()[0] for f in later.sent if f.type == FrameType.ARM]
        assert later.ramp.link is LinkState.READY
        assert set(sent) == {there}


@pytest.mark.long
def test_a_greeting_of_an_old_handshake_does_not_hide_that_the_board_has_pulses(config: Config) -> None:
    """Else the arm would be armed elsewhere than it stands: a jump."""
    line = RampWithBoard(config)
    line.tick()
    old = line.back
    line.ready()
    line.tick(line.order())
    line.tick()
    for later in whatever_its_number(line):
        while later.ramp.link is not LinkState.GREETING:
            later.back = b""
            later.tick()
        for _ in range(10):  # frames that wait for an answer
            later.back = b""
            later.tick()
        for _ in range(6):
            later.back = old + later.back
            later.tick()
        assert later.ramp.link is LinkState.READY
        assert later.ramp.outputs == later.ramp.board_outputs != 0


def whatever_its_number(line: RampWithBoard) -> Iterator[RampWithBoard]:
    """The same as if it had sent more frames before: a recorded answer has the right number in one of them."""
    for more in range(NUMBERS):
        later = deepcopy(line)
        later.ramp.sent += more
        yield later


def test_a_greeting_of_an_old_handshake_does_not_answer_a_new_one(config: Config) -> None:
    line = RampWithBoard(config)
    line.tick()
    old = line.back
    assert [f.type for f in frames(old)] == [FrameType.INFO]
    line.ready()
    line.tick(line.order())
    line.tick()
    line.back = b""
    line.tick(pause=config.link.silence_ms * 1_000_000)  # a pause of our own: greeting
    for _ in range(3):
        line.back = old
        line.tick()
        assert {f.type for f in line.sent} == {FrameType.HELLO}


@pytest.mark.long
@given(seq=st.integers(1, 60))
@examples(15, 30)
def test_a_dead_board_is_not_hidden_by_one_old_acknowledgement(config: Config, seq: int) -> None:
    line = moving(config)
    for _ in range(80):
        line.tick()
    boot = line.board.boot
    ticks = 0
    line.tick()
    while line.ramp.link is LinkState.READY:
        line.back = encode(protocol.ack(seq, ALIVE, boot))
        line.tick()
        ticks += 1
        assert ticks * TICK <= config.reply + 2 * TICK
    assert line.ramp.fault is RampFault.LINK_LOST
    assert line.sent[0].type == FrameType.HELLO


def test_nor_by_all_that_it_ever_said(config: Config) -> None:
    line = moving(config)
    heard = b""
    for _ in range(300):
        heard += line.back
        line.tick()
    line.tick()
    ticks = 0
    while line.ramp.link is LinkState.READY:
        line.back = heard
        line.tick()
        ticks += 1
        assert ticks * TICK <= config.reply + 2 * TICK


@given(copies=st.integers(2, 6))
@examples(5, 10)
def test_a_repeated_acknowledgement_is_one_step(config: Config, copies: int) -> None:
    line = moving(config)
    line.tick(order := line.order(2, target=(MIDDLE + 100_000,) * 16))
    line.tick(order)
    acknowledged, position, reply = line.ramp.acknowledged, line.ramp.position[0], line.back
    for _ in range(copies):
        line.back = reply
        line.tick(order)
    assert line.ramp.acknowledged == acknowledged + 1
    assert line.ramp.position[0] == position + 1000


def test_no_frame_has_the_number_of_a_refusal_of_what_was_no_frame(config: Config) -> None:
    line = moving(config)
    numbers = []
    for _ in range(2 * NUMBERS):
        line.tick()
        numbers += [f.seq for f in line.sent]
    assert set(numbers) == set(range(1, 256))
    assert all(b == a % 255 + 1 for a, b in pairwise(numbers))


WAITED = st.lists(st.tuples(st.integers(1, 6), st.integers(0, 300)), max_size=40)


@given(WAITED)
def test_every_frame_is_answered_at_most_once_and_in_order(steps: list[tuple[int, int]]) -> None:
    """Frames sent a few at a time, then any number acknowledged: only those that wait, each later than the last."""
    link, sent, answered = BoardLink(10**8), 0, -1
    for more, guess in steps:
        for _ in range(more):
            link.wait(sent * TICK)
            link.send(protocol.arm(sent % NUMBERS + 1, {}), sent, sent * TICK)
            sent += 1
        reply = protocol.ack(guess % 256, ALIVE, 1)
        before, found = answered, link.answers([reply, reply])
        assert len(found) <= 1
        for _, frame in found:
            answered = frame.number
            assert frame.seq == reply.seq
            assert max(before, sent - 1 - NUMBERS) < answered < sent


def test_the_table_makes_ready_only_by_the_answer_that_belongs_to_each_state() -> None:
    ready = {key for key, (state, _) in TABLE.items() if state is LinkState.READY and key[0] is not LinkState.READY}
    assert ready == {
        (LinkState.GREETING, BoardReply.RESTING), (LinkState.READING, BoardReply.REGISTERS),
        (LinkState.SETTING_UP, BoardReply.WAS_SET_UP),
    }  # fmt: skip
    adopting = {key for key, (_, action) in TABLE.items() if action is Action.ADOPT}
    assert adopting == {(LinkState.READING, BoardReply.REGISTERS)}
    for reply in BoardReply:
        assert (LinkState.CLOSED, reply) not in TABLE


@pytest.mark.parametrize(("state", "reply"), list(product(LinkState, BoardReply)))
def test_a_reply_that_is_not_in_the_table_changes_nothing(state: LinkState, reply: BoardReply) -> None:
    link = BoardLink(10**8)
    link.begin(state)
    action = link.step(reply)
    assert (link.state, action) == TABLE.get((state, reply), (state, None))


@pytest.mark.long
@given(before=st.integers(0, 12), silent=st.integers(1, 400), pulsing=st.booleans(), restart=st.booleans())
@examples(30, 60)
def test_a_chip_that_answers_is_used(config: Config, before: int, silent: int, pulsing: bool, restart: bool) -> None:
    """Whenever it was silent: at power-on, in the handshake, at rest or with pulses, the host's program being restarted
    meanwhile or not. The pulses stay off, or as they were."""
    line = RampWithBoard(config)
    for _ in range(before):
        line.tick(line.order() if pulsing and line.ramp.link is LinkState.READY else None)
    pulses = count(line)
    line.board.chip.answers = False
    for n in range(silent):
        line.tick()
        if restart and n == silent // 2:
            line.ramp.opened(line.now)
    line.board.chip.answers = True
    for _ in range((config.reply + config.link.silence_ms * 1_000_000) // TICK + 20):
        line.tick()
    assert line.ramp.link is LinkState.READY
    assert count(line) in (0, pulses)
