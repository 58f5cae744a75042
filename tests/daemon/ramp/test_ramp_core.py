"""The ramp core with a simulated board: accepted orders, adopted registers, limits."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.api.children import board_settings
from lrmd.config import MS, Config
from lrmd.link import protocol
from lrmd.link.frames import FrameType, encode
from lrmd.ramp.core import RampCore
from lrmd.ramp.process import STANDBY_TICKS
from lrmd.ramp.shared_memory import LinkState, RampFault, RampOrder
from lrmd.ramp.stepping import Pace, Way, move
from tests.support.daemon.ramp_with_board import MIDDLE, TICK, RampWithBoard
from tests.support.sweep import examples


def test_a_new_order_switches_on_at_its_pose_and_moves(config: Config) -> None:
    line = RampWithBoard(config).ready()
    line.tick(line.order())
    assert line.sent[0].word_by_bit()[0] == round(MIDDLE * 1e-9 / config.clock.count_s)
    order = line.order(2, target=(MIDDLE + 5_000,) * 16)
    for _ in range(6):
        line.tick(order)
    assert line.ramp.position[0] == MIDDLE + 5_000
    assert not line.ramp.moving


def test_it_stands_by_only_with_all_pulses_off_and_a_reply_to_the_last_frame(config: Config) -> None:
    line = RampWithBoard(config).ready()
    for _ in range(20):
        line.tick(pause=STANDBY_TICKS * TICK)
        assert line.ramp.standing_by
        assert line.ramp.link is LinkState.READY
    line.back = b""  # a reply is lost: the next ticks come at the full rate
    line.tick(pause=STANDBY_TICKS * TICK)
    assert not line.ramp.standing_by
    line.tick()
    assert line.ramp.standing_by
    line.tick(line.order())
    for _ in range(5):
        assert not line.ramp.standing_by
        line.tick()
    line.tick(estop=True)
    assert not line.ramp.standing_by
    line.tick()
    line.tick()
    assert line.ramp.standing_by


@pytest.mark.parametrize("missed", [1, 2, 7])
def test_an_order_made_before_the_last_fault_is_dropped(config: Config, missed: int) -> None:
    line = RampWithBoard(config).ready()
    line.tick(line.order(fault_count=line.ramp.fault_count - missed))
    assert not line.ramp.order_accepted
    assert line.ramp.outputs == 0
    line.tick(line.order(2))
    assert line.ramp.order_accepted


@pytest.mark.parametrize("late_ms", [0, 400, 600, 60_000])
def test_an_order_for_pulses_that_comes_late_moves_and_switches_on_nothing(config: Config, late_ms: int) -> None:
    """The API process was stopped between its decision and its order: whoever asked is gone by then."""
    line = RampWithBoard(config).ready()
    late = line.order(outputs=0b11)
    line.now += late_ms * 1_000_000
    line.ready()
    line.tick(replace(late, fault_count=line.ramp.fault_count))
    line.tick()
    in_time = late_ms < 500
    assert line.ramp.order_accepted is in_time
    assert (line.board.chip.pulse(0) is not None) is in_time
    assert (line.ramp.fault is RampFault.API_SILENT) is not in_time


def test_an_order_that_ends_pulses_is_never_too_late(config: Config) -> None:
    line = RampWithBoard(config).ready()
    line.tick(line.order())
    line.tick()
    off = line.order(2, outputs=0)
    for _ in range(200):
        line.tick()
    line.tick(replace(off, fault_count=line.ramp.fault_count))
    line.tick()
    assert line.ramp.order_accepted
    assert line.board.chip.pulse(0) is None


def test_a_motion_does_not_go_on_from_registers_that_were_taken_over(config: Config) -> None:
    """A board that says in the middle of a motion that it is not set up is asked for its registers: a frame may be
    lost by then, so that the next step of the motion is two of the board's."""
    line = RampWithBoard(config).ready()
    line.tick(line.order(target=(MIDDLE + 100_000,) * 16))
    for _ in range(4):
        line.tick()
    there, count = line.board.chip.pulse(0), config.clock.count_s
    line.back = encode(protocol.error(line.sent[0].seq, protocol.ErrorCode.NOT_SET_UP))
    for _ in range(20):
        line.tick()
        assert line.board.chip.pulse(0) == pytest.approx(there, abs=1.1 * count)
    assert line.ramp.link is LinkState.READY
    assert not line.ramp.moving


def test_an_emergency_stop_voids_the_order_under_way(config: Config) -> None:
    line = RampWithBoard(config).ready()
    order = line.order(target=(MIDDLE + 50_000,) * 16)
    line.tick(order)
    line.tick(order, estop=True)
    assert line.ramp.fault is RampFault.ESTOP
    assert set(line.sent[0].words) == {0}
    stale = replace(order, number=2)
    for _ in range(5):
        line.tick(stale)
    assert line.ramp.outputs == 0


@pytest.mark.parametrize(
    "changes",
    [
        {"target": (2_600_000,) * 16},
        {"target": (100_000,) * 16},
        {"pose": (3_000_000,) * 16},
        {"stride": (1001,) * 16},
        {"stride": (0,) * 16},
    ],
)
def test_an_order_outside_the_limits_is_refused_whole(config: Config, changes: dict) -> None:
    line = RampWithBoard(config).ready()
    line.tick(line.order(**changes))
    assert (line.ramp.fault, line.ramp.order_accepted, line.ramp.outputs) == (RampFault.REFUSED, False, 0)
    line.tick()
    assert line.board.chip.pulse(0) is None


def test_after_a_pause_of_its_own_it_queries_the_board_before_it_sends_pulses(config: Config) -> None:
    line = RampWithBoard(config).ready()
    for _ in range(3):
        line.tick(line.order())
    assert line.sent[0].type == FrameType.ARM
    line.tick(pause=config.link.silence_ms * MS)
    assert line.sent[0].type == FrameType.HELLO


@given(late_ms=st.integers(7, 490))
@examples(15, 30)
def test_a_late_tick_that_comes_before_the_reply_loses_no_link(config: Config, late_ms: int) -> None:
    line = RampWithBoard(config).ready()
    line.tick(line.order())
    reply, line.back = line.back, b""
    faults = line.ramp.fault_count
    line.tick(pause=late_ms * MS)
    line.back = reply + line.back
    line.tick()
    assert (line.ramp.link, line.ramp.fault_count) == (LinkState.READY, faults)


def test_a_board_that_does_not_reply_is_lost_after_the_timeout(config: Config) -> None:
    line = RampWithBoard(config).ready()
    ticks = 0
    while line.ramp.link is LinkState.READY:
        line.back = b""
        line.tick()
        ticks += 1
    assert config.reply < ticks * TICK <= config.reply + 2 * TICK
    assert line.ramp.fault is RampFault.LINK_LOST


@given(register=st.integers(200, 400), seed=st.integers(0, 100))
@examples(20, 40)
def test_it_adopts_exactly_the_registers_of_the_board(config: Config, register: int, seed: int) -> None:
    line = RampWithBoard(config).ready()
    line.tick(line.order())
    line.tick()
    report = line.ramp.report(0, line.now, 0, 0, 1, False)
    line.board.feed(encode(protocol.arm(seed, {0: register})), line.now)
    line.ramp, line.back = RampCore(board_settings(config), report), b""
    line.ramp.opened(line.now)
    line.ready()
    line.tick()
    assert line.sent[0].type == FrameType.ARM
    assert line.sent[0].word_by_bit()[0] == register
    assert line.ramp.position[0] == pytest.approx(register * config.clock.count_s * 1e9, abs=4_882)
    assert not line.ramp.moving


@pytest.mark.parametrize("how", ["order", "estop"])
def test_what_it_switched_off_is_no_pose_to_take_over_before_the_board_has_replied(config: Config, how: str) -> None:
    line = RampWithBoard(config).ready()
    line.tick(line.order())
    line.tick()
    line.ramp.close()
    line.back = b""
    line.ramp.opened(line.now)
    line.ready()
    assert (line.ramp.outputs, line.ramp.board_outputs) == (1, 1)
    there = line.ramp.register[0]
    order = line.order(2, target=(there + 10_000,) * 16)
    for _ in range(12):
        line.tick(order)
    assert line.ramp.position[0] == there + 10_000
    if how == "estop":
        line.tick(estop=True)
    else:
        line.tick(line.order(3, outputs=0))
    assert (line.ramp.outputs, line.ramp.board_outputs) == (0, 0)
    line.tick()
    line.tick()
    assert line.board.chip.pulse(0) is None


def test_a_board_with_another_prescale_is_left_to_fall_silent_before_it_is_set_up(config: Config) -> None:
    line = RampWithBoard(config)
    line.board.feed(encode(protocol.setup(1, 60, 1000)), line.now)
    line.board.feed(encode(protocol.arm(2, {0: 300})), line.now)
    for _ in range(50):
        line.tick()
        assert line.board.chip.pulse(0) is not None
        assert line.ramp.link is LinkState.GREETING
    for _ in range(120):
        line.tick()
    assert line.board.chip.pulse(0) is None
    assert line.ramp.link is LinkState.READY


@pytest.mark.parametrize("kind", [0, 1])
def test_a_simulated_clock_drives_no_real_board(config: Config, kind: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lrmd.sim.board.SIMULATED", kind)
    line = RampWithBoard(config)
    line.ramp = RampCore(board_settings(config, speed=2.0))
    line.ramp.opened(line.now)
    for _ in range(20):
        line.tick(line.order())
    assert (line.ramp.link is LinkState.READY) == (kind == 1)
    assert kind == 1 or {frame.type for frame in line.sent} == {FrameType.HELLO}


@given(st.lists(st.binary(max_size=60), max_size=30))
@examples(30, 60)
def test_no_bytes_from_the_port_can_stop_it_or_switch_anything_on(config: Config, noise: list[bytes]) -> None:
    line = RampWithBoard(config).ready()
    for data in noise:
        line.back = data
        line.tick()
        assert line.ramp.outputs == 0
        assert line.board.chip.pulse(0) is None


def branching(line: RampWithBoard, number: int, branch_at: int, target: int, after: int | None = None) -> RampOrder:
    """An order that leaves the motion of the last one where so many ticks of it remain."""
    before = number - 1 if after is None else after
    return line.order(number, target=(target,) * 16, after=before, branch_at=branch_at)


@pytest.mark.long
@given(length=st.integers(5, 40), branch_at=st.integers(0, 40), read_at=st.integers(0, 40))
@examples(20, 40)
def test_an_order_branches_off_where_it_says_or_the_servos_stop(
    config: Config, length: int, branch_at: int, read_at: int
) -> None:
    line = RampWithBoard(config).ready()
    line.tick(line.order(outputs=1, target=(MIDDLE + 1000 * length,) * 16))
    for _ in range(min(read_at, length - 1)):
        line.tick()
    left, visited = line.ramp.remaining, {line.ramp.position[0]}
    line.tick(branching(line, 2, branch_at, MIDDLE - 20_000))
    visited.add(line.ramp.position[0])
    for _ in range(200):
        line.tick()
        visited.add(line.ramp.position[0])
    if branch_at <= left:
        assert line.ramp.order_accepted
        assert max(visited) == MIDDLE + 1000 * (length - branch_at), "it turns exactly there"
        assert line.ramp.position[0] == MIDDLE - 20_000
    else:
        assert not line.ramp.order_accepted
        assert not line.ramp.moving
        assert visited == {MIDDLE + 1000 * (length - left)}, "too late: it stops where it is"


def test_an_order_after_one_that_was_never_read_stops_the_servos(config: Config) -> None:
    line = RampWithBoard(config).ready()
    line.tick(line.order(outputs=1, target=(MIDDLE + 50_000,) * 16))
    line.tick()
    line.tick(branching(line, 3, 0, MIDDLE, after=2))
    assert not line.ramp.order_accepted
    assert not line.ramp.moving


MOVES = st.lists(st.integers(-30_000, 30_000), min_size=1, max_size=6)


@given(MOVES, st.data())
def test_a_way_with_branches_is_the_staircases_one_after_the_other(distances: list[int], data) -> None:
    """Against the list of its pulses, tick by tick."""
    way, pulses, here = Way(), [(0,)], (0,)
    for distance in distances:
        way = way.advanced_to(data.draw(st.integers(0, way.remaining)))
        left = data.draw(st.integers(0, way.remaining))
        pulses = pulses[: len(pulses) - left]
        here = way.at(left) if way.parts else pulses[-1]
        assert here == pulses[-1]
        onward = move(here, (here[0] + distance,), (1000,), Pace.TOGETHER)
        way = way.branch(left if way.parts else 0, onward)
        pulses += [onward.at(k) for k in range(1, onward.length + 1)]
    while way.remaining:
        assert way.at(way.remaining - 1) == pulses[len(pulses) - way.remaining]
        way = way.step()
