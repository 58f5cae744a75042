"""Shaped moves: the same way and the same step at most, no stop is delayed, and nothing without a motion model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.control.motion_predictor import MotionPredictor
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.messages.control import HoldRequest, MoveRequest
from lrmd.messages.surroundings import ContactEntry
from lrmd.ramp.shared_memory import RampFault, RampOrder
from lrmd.ramp.stepping import MOST_DELAY, SHARES, Pace, move, valid_impulses, valid_waits
from tests.daemon.control.test_motion_laws import armed, commanded, keep
from tests.support.daemon.in_memory_daemon import SimulatedDaemon, config_at
from tests.support.motion_models import swinging
from tests.support.sweep import examples, soak

MODEL = swinging(joint1=(3.0, 0.03), joint2=(4.0, 0.05))
GOAL = {"joint1": 0.5, "joint2": -0.3}
TOUCH = ContactEntry(first="tool", second="table", low_m=[-1.0] * 3, high_m=[1.0] * 3)
impulses = st.lists(st.tuples(st.integers(0, MOST_DELAY), st.integers(1, 200)), min_size=1, max_size=20).map(
    lambda rows: (*rows[:-1], (rows[-1][0], SHARES - sum(share for _, share in rows[:-1])))
)
waits = st.lists(st.tuples(st.integers(1, 400), st.integers(1, 12)), max_size=20, unique_by=lambda row: row[0]).map(
    lambda rows: tuple(sorted(rows, reverse=True))
)
pulses = st.lists(st.integers(500_000, 2_500_000), min_size=3, max_size=3)


@pytest.fixture
def sim(tmp_path) -> SimulatedDaemon:
    config = config_at(330.0, tmp_path)
    sim = SimulatedDaemon(config)
    sim.core.motion = MotionPredictor(config, MODEL)
    sim.run(30)
    return sim


@given(pulses, pulses, st.lists(st.integers(1, 1000), min_size=3, max_size=3), st.sampled_from(Pace), impulses)
def test_no_tick_of_a_shaped_move_is_longer_and_it_ends_where_the_move_ends(start, target, stride, pace, shape) -> None:
    assert valid_impulses(shape)
    shaped, plain = move(start, target, stride, pace, shape), move(start, target, stride, pace)
    if plain.length:
        assert shaped.length == plain.length + max(delay for delay, _ in shape)
    ticks = np.unique(np.linspace(0, shaped.length, 200).astype(int))
    for k in ticks[:-1]:
        steps = [abs(b - a) for a, b in zip(shaped.at(int(k)), shaped.at(int(k) + 1), strict=True)]
        assert all(step <= most for step, most in zip(steps, stride, strict=True))
    assert shaped.at(0) == tuple(start)
    assert shaped.at(shaped.length) == tuple(target)


@given(pulses, pulses, impulses)
def test_a_shaped_move_takes_the_way_of_the_move(start, target, shape) -> None:
    """Together: all servos have the same share of their way behind them, to the ns."""
    shaped = move(start, target, (1000,) * 3, Pace.TOGETHER, shape)
    way = np.array(target) - np.array(start)
    longest = int(np.argmax(np.abs(way)))
    if not way[longest]:
        return
    for k in np.linspace(0, shaped.length, 50).astype(int):
        here = np.array(shaped.at(int(k))) - np.array(start)
        np.testing.assert_allclose(here, way * (here[longest] / way[longest]), atol=2.0)


@given(pulses, pulses, st.lists(st.integers(1, 1000), min_size=3, max_size=3), st.sampled_from(Pace), waits)
def test_a_move_that_waits_stands_still_there_and_takes_the_same_steps(start, target, stride, pace, there) -> None:
    """Without its repetitions it is the move without waits, row by row; it is longer by the waits."""
    assert valid_waits(there)
    plain = move(start, target, stride, pace)
    kept = tuple(row for row in there if row[0] <= plain.length)
    waiting = move(start, target, stride, pace, (), kept)
    begin = max(0, plain.length - 450)
    base = iter([plain.at(k) for k in range(begin, plain.length + 1)])
    expected = []
    for remaining, row in zip(range(plain.length - begin, -1, -1), base, strict=True):
        expected += [row] * (1 + dict(kept).get(remaining, 0))
    assert waiting.length == plain.length + (sum(ticks for _, ticks in kept) if plain.length else 0)
    assert [waiting.at(k) for k in range(begin, waiting.length + 1)] == expected


def test_a_move_that_stays_takes_no_time() -> None:
    assert move((1,) * 3, (1,) * 3, (1000,) * 3, Pace.TOGETHER, ((0, SHARES // 2), (9, SHARES // 2))).length == 0


@pytest.mark.parametrize("shape", [((0, SHARES - 1),), ((0, SHARES), (1, 0)), ((MOST_DELAY + 1, SHARES),)])
def test_impulses_that_are_none_are_refused_by_the_ramp(sim: SimulatedDaemon, shape) -> None:
    armed(sim)
    assert not valid_impulses(shape)
    delay, share = zip(*((*shape, (0, 1)) if shape[-1][1] == 0 else shape), strict=True)
    order = replace(sim.order, number=sim.order.number + 1, target=sim.ramp.position, delay=delay, share=share)
    sim.ramp._check_order(RampOrder.unpack(order.pack()), sim.now)
    assert not sim.ramp.order_accepted
    assert sim.ramp.fault is RampFault.REFUSED


@pytest.mark.parametrize("waits", [((3, 5), (9, 5)), ((3, 5), (3, 5)), ((0, 5),), ((9, MOST_DELAY + 1),)])
def test_waits_that_are_none_are_refused_by_the_ramp(sim: SimulatedDaemon, waits) -> None:
    armed(sim)
    assert not valid_waits(waits)
    at, ticks = zip(*waits, strict=True)
    order = replace(sim.order, number=sim.order.number + 1, target=sim.ramp.position, wait_at=at, wait=ticks)
    sim.ramp._check_order(RampOrder.unpack(order.pack()), sim.now)
    assert not sim.ramp.order_accepted
    assert sim.ramp.fault is RampFault.REFUSED


@pytest.mark.long
def test_a_timed_move_waits_before_its_end_and_settles_sooner(tmp_path) -> None:
    """At 50 Hz. The ramp takes the ticks that the controller foresees; only the last of two legs is timed."""
    config = config_at(50.0, tmp_path)
    sim = SimulatedDaemon(config)
    sim.core.motion = MotionPredictor(config, MODEL)
    sim.run(30)
    token = armed(sim)
    found = {}
    for shaping in ("off", "timed"):
        zero = MoveRequest(lease=token, waypoints=[{"joint1": 0.0, "joint2": 0.0}], shaping="off")
        keep(sim, token, int(sim.core.handle(zero, sim.now).seconds / 0.0065) + 30)
        request = MoveRequest(lease=token, waypoints=[GOAL], shaping=shaping)
        found[shaping] = sim.core.handle(request, sim.now)
        keep(sim, token, 2)
        for _ in range(1000):
            if not sim.ramp.moving:
                break
            assert sim.ramp.position == sim.core.orders.way.at(sim.ramp.remaining)
            keep(sim, token, 1)
        assert commanded(sim, 1) == pytest.approx(0.5, abs=1e-6)
    assert found["off"].final_leg.move.waits == ()
    waited = sum(ticks for _, ticks in found["timed"].final_leg.move.waits)
    assert found["timed"].seconds == pytest.approx(found["off"].seconds + 0.0065 * waited, abs=0.0066)
    timed, plain = (sim.core.motion.settling(found[kind].final_leg) for kind in ("timed", "off"))
    assert timed.usual < 0.7 * plain.usual
    assert (timed.usual < timed.sure, plain.usual < plain.sure) == (True, True)
    two = MoveRequest(lease=token, waypoints=[{"joint1": 0.0}, GOAL], shaping="timed")
    sim.core.handle(two, sim.now)
    assert sim.core.orders.way.parts[-1][0].impulses != ()
    assert [leg.waits != () for leg in sim.core.orders.legs] == [True]


@pytest.mark.long
def test_a_shaped_move_arrives_when_it_says_and_is_longer_by_its_shaper(sim: SimulatedDaemon) -> None:
    token = armed(sim)
    plain = sim.core.handle(MoveRequest(lease=token, waypoints=[GOAL], shaping="off"), sim.now)
    keep(sim, token, int(plain.seconds / 0.0065) + 30)
    sim.core.handle(MoveRequest(lease=token, waypoints=[{"joint1": 0.0, "joint2": 0.0}]), sim.now)
    keep(sim, token, int(plain.seconds / 0.0065) + 30)
    shaped = sim.core.handle(MoveRequest(lease=token, waypoints=[GOAL], shaping="zv"), sim.now)
    assert plain.seconds + 0.1 < shaped.seconds < plain.seconds + 0.6
    keep(sim, token, int(shaped.seconds / 0.0065) - 10)
    assert sim.core.mode is Mode.MOVING
    keep(sim, token, 40)
    assert sim.core.mode is Mode.ARMED
    assert commanded(sim, 1) == pytest.approx(0.5, abs=1e-6)
    known = sim.core.motion
    assert known is not None
    assert known.settling(shaped.final_leg).usual < 0.5 * known.settling(plain.final_leg).usual


def test_a_hold_and_an_emergency_stop_end_a_shaped_move_at_once(sim: SimulatedDaemon) -> None:
    token = armed(sim)
    for stop, shaping in (("hold", "zvdd"), ("hold", "timed"), ("estop", "zvdd")):
        goal = {"joint1": 1.0 if commanded(sim, 1) < 0.5 else 0.0}
        sim.core.handle(MoveRequest(lease=token, waypoints=[goal], shaping=shaping), sim.now)
        keep(sim, token, 100)
        assert sim.ramp.moving
        if stop == "hold":
            sim.core.handle(HoldRequest(), sim.now)
            sim.order = sim.core.order
            keep(sim, token, 2)
            assert not sim.ramp.moving
            there = commanded(sim, 1)
            keep(sim, token, 50)
            assert commanded(sim, 1) == there
        else:
            sim.estop_requested = True
            sim.core.estop(sim.now, "test")
            sim.run(2)
            assert all(pulse is None for pulse in sim.outputs.values())


def test_each_at_its_own_rate_and_contacts_are_not_shaped(sim: SimulatedDaemon) -> None:
    token = armed(sim)
    request = MoveRequest(lease=token, waypoints=[GOAL], pace="each", shaping="zv")
    assert sim.core.handle(request, sim.now).final_leg.move.impulses == ()
    keep(sim, token, 30)
    touching = MoveRequest(lease=token, waypoints=[GOAL], may_touch=[TOUCH], shaping="zv")
    with pytest.raises(RequestError, match="not shaped"):
        sim.core.handle(touching, sim.now)


def test_without_a_motion_model_nothing_is_shaped_nor_predicted(sim: SimulatedDaemon) -> None:
    token = armed(sim)
    sim.core.motion = None
    with pytest.raises(RequestError, match="motion model"):
        sim.core.handle(MoveRequest(lease=token, waypoints=[GOAL], shaping="zv"), sim.now)
    assert sim.core.handle(MoveRequest(lease=token, waypoints=[GOAL]), sim.now).final_leg.move.impulses == ()


def test_the_shaping_of_the_configuration_waits_for_a_model(tmp_path) -> None:
    config = config_at(330.0, tmp_path)
    config = replace(config, motion=config.motion.model_copy(update={"shaping": "zv"}))
    sim = SimulatedDaemon(config)
    sim.run(30)
    token = armed(sim)
    request = MoveRequest(lease=token, waypoints=[GOAL])
    assert sim.core.handle(request, sim.now).final_leg.move.impulses == ()
    sim.core.motion = MotionPredictor(config, MODEL)
    keep(sim, token, 30)
    back = MoveRequest(lease=token, waypoints=[{"joint1": 0.0, "joint2": 0.0}])
    assert sim.core.handle(back, sim.now).final_leg.move.impulses != ()


@pytest.mark.long
@pytest.mark.parametrize("shaping", ["zvdd", *soak("off")])
@examples(3, 20)
@given(at=st.integers(1, 250), soft=st.floats(1.0, 12.0))
def test_another_model_leaves_a_motion_under_way_as_it_was_ordered(shaping, at, soft, tmp_path_factory) -> None:
    """Tick by tick the pulses are those of a daemon whose model stays; the model is taken away, or another is there."""
    config = config_at(330.0, tmp_path_factory.mktemp("config"))
    ways = []
    for other in (None, MotionPredictor(config, swinging(joint1=(soft, 0.02))), "stays"):
        sim = SimulatedDaemon(config)
        sim.core.motion = MotionPredictor(config, MODEL)
        sim.run(30)
        token = armed(sim)
        sim.core.handle(MoveRequest(lease=token, waypoints=[GOAL], shaping=shaping), sim.now)
        way = []
        for tick in range(300):
            if tick == at and other != "stays":
                sim.core.motion = other
            keep(sim, token, 1)
            way.append(sim.ramp.position)
        ways.append(way)
    assert ways[0] == ways[1] == ways[2]
    assert len(set(ways[0])) > 50
