"""Shaped moves: the same way and the same step at most, no stop is delayed, and nothing without a motion model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.motion.motion_model import MotionModel
from lrmd.config import Config
from lrmd.control.motion_predictor import MotionPredictor
from lrmd.control.state import RequestResult
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.messages.control import HoldRequest, MoveRequest
from lrmd.messages.surroundings import ContactEntry
from lrmd.ramp.shared_memory import RampFault, RampOrder
from lrmd.ramp.stepping import MOST_DELAY, SHARES, Pace, move, valid_impulses, valid_waits
from tests.daemon.control.test_motion_laws import commanded
from tests.support.daemon.armed_daemon import ArmedDaemon
from tests.support.daemon.in_memory_daemon import config_at
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


def armed(config: Config, model: MotionModel | None = MODEL) -> ArmedDaemon:
    """At 0, with a motion model."""
    sim = ArmedDaemon(config)
    sim.core.motion = model and MotionPredictor(config, model)
    sim.arm("given", [0.0] * 6)
    return sim


@pytest.fixture
def sim(tmp_path) -> ArmedDaemon:
    return armed(config_at(330.0, tmp_path))


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


@pytest.mark.parametrize(("valid", "fields", "rows"), [
    *((valid_impulses, ("delay", "share"), shape) for shape in (
        ((0, SHARES - 1),), ((0, SHARES), (1, 0)), ((MOST_DELAY + 1, SHARES),),
    )),
    *((valid_waits, ("wait_at", "wait"), waits) for waits in (
        ((3, 5), (9, 5)), ((3, 5), (3, 5)), ((0, 5),), ((9, MOST_DELAY + 1),),
    )),
])  # fmt: skip
def test_impulses_and_waits_that_are_none_are_refused_by_the_ramp(sim: ArmedDaemon, valid, fields, rows) -> None:
    assert not valid(rows)
    columns = zip(*((*rows, (0, 1)) if rows[-1][1] == 0 else rows), strict=True)
    changes = dict(zip(fields, columns, strict=True))
    order = replace(sim.order, number=sim.order.number + 1, target=sim.ramp.position, **changes)
    sim.ramp._check_order(RampOrder.unpack(order.pack()), sim.now)
    assert not sim.ramp.order_accepted
    assert sim.ramp.fault is RampFault.REFUSED


@pytest.mark.long
def test_a_timed_move_waits_before_its_end_and_settles_sooner(tmp_path) -> None:
    """At 50 Hz. The ramp takes the ticks that the controller foresees; only the last of two legs is timed."""
    sim, found = armed(config_at(50.0, tmp_path)), {}
    for shaping in ("off", "timed"):
        sim.keep(int(sim.start([0.0, 0.0], shaping="off") / 0.0065) + 30)
        found[shaping] = ordered(sim, shaping=shaping)
        sim.settle()
        for _ in range(1000):
            if not sim.ramp.moving:
                break
            assert sim.ramp.position == sim.core.orders.way.at(sim.ramp.remaining)
            sim.keep(1)
        assert commanded(sim, 1) == pytest.approx(0.5, abs=1e-6)
    assert found["off"].final_leg.move.waits == ()
    waited = sum(ticks for _, ticks in found["timed"].final_leg.move.waits)
    assert found["timed"].seconds == pytest.approx(found["off"].seconds + 0.0065 * waited, abs=0.0066)
    timed, plain = (sim.core.motion.settling(found[kind].final_leg) for kind in ("timed", "off"))
    assert timed.usual < 0.7 * plain.usual
    assert (timed.usual < timed.sure, plain.usual < plain.sure) == (True, True)
    ordered(sim, {"joint1": 0.0}, GOAL, shaping="timed")
    assert sim.core.orders.way.parts[-1][0].impulses != ()
    assert [leg.waits != () for leg in sim.core.orders.legs] == [True]


def ordered(sim: ArmedDaemon, *waypoints: dict[str, float], **more: Any) -> RequestResult:
    """What the daemon says to a move to `GOAL`, or elsewhere."""
    return sim.core.handle(MoveRequest(lease=sim.token, waypoints=list(waypoints) or [GOAL], **more), sim.now)


@pytest.mark.long
def test_a_shaped_move_arrives_when_it_says_and_is_longer_by_its_shaper(sim: ArmedDaemon) -> None:
    plain = ordered(sim, shaping="off")
    sim.keep(int(plain.seconds / 0.0065) + 30)
    sim.start([0.0, 0.0])
    sim.keep(int(plain.seconds / 0.0065) + 30)
    shaped = ordered(sim, shaping="zv")
    assert plain.seconds + 0.1 < shaped.seconds < plain.seconds + 0.6
    sim.keep(int(shaped.seconds / 0.0065) - 10)
    assert sim.core.mode is Mode.MOVING
    sim.keep(40)
    assert sim.core.mode is Mode.ARMED
    assert commanded(sim, 1) == pytest.approx(0.5, abs=1e-6)
    known = sim.core.motion
    assert known.settling(shaped.final_leg).usual < 0.5 * known.settling(plain.final_leg).usual


def test_a_hold_and_an_emergency_stop_end_a_shaped_move_at_once(sim: ArmedDaemon) -> None:
    for stop, shaping in (("hold", "zvdd"), ("hold", "timed"), ("estop", "zvdd")):
        ordered(sim, {"joint1": 1.0 if commanded(sim, 1) < 0.5 else 0.0}, shaping=shaping)
        sim.keep(100)
        assert sim.ramp.moving
        if stop == "hold":
            sim.core.handle(HoldRequest(), sim.now)
            sim.order = sim.core.order
            sim.keep(2)
            assert not sim.ramp.moving
            there = commanded(sim, 1)
            sim.keep(50)
            assert commanded(sim, 1) == there
        else:
            sim.estop()
            sim.run(2)
            assert sim.limp


def test_each_at_its_own_rate_and_contacts_are_not_shaped(sim: ArmedDaemon) -> None:
    assert ordered(sim, pace="each", shaping="zv").final_leg.move.impulses == ()
    sim.keep(30)
    with pytest.raises(RequestError, match="not shaped"):
        ordered(sim, may_touch=[TOUCH], shaping="zv")


def test_without_a_motion_model_nothing_is_shaped_nor_predicted(sim: ArmedDaemon) -> None:
    sim.core.motion = None
    with pytest.raises(RequestError, match="motion model"):
        ordered(sim, shaping="zv")
    assert ordered(sim).final_leg.move.impulses == ()


def test_the_shaping_of_the_configuration_waits_for_a_model(tmp_path) -> None:
    sim = armed(config_at(330.0, tmp_path, "zv"), None)
    assert ordered(sim).final_leg.move.impulses == ()
    sim.core.motion = MotionPredictor(sim.config, MODEL)
    sim.keep(30)
    assert ordered(sim, {"joint1": 0.0, "joint2": 0.0}).final_leg.move.impulses != ()


@pytest.mark.long
@pytest.mark.parametrize("shaping", ["zvdd", *soak("off")])
@examples(3, 20)
@given(at=st.integers(1, 250), soft=st.floats(1.0, 12.0))
def test_another_model_leaves_a_motion_under_way_as_it_was_ordered(shaping, at, soft, tmp_path_factory) -> None:
    """Tick by tick the pulses are those of a daemon whose model stays; the model is taken away, or another is there."""
    config = config_at(330.0, tmp_path_factory.mktemp("config"))
    ways = []
    for other in (None, MotionPredictor(config, swinging(joint1=(soft, 0.02))), "stays"):
        sim, way = armed(config), []
        ordered(sim, shaping=shaping)
        for tick in range(300):
            if tick == at and other != "stays":
                sim.core.motion = other
            sim.keep(1)
            way.append(sim.ramp.position)
        ways.append(way)
    assert ways[0] == ways[1] == ways[2]
    assert len(set(ways[0])) > 50
