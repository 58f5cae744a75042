"""The cases: which effects are hidden, and what the tool should name them."""

from __future__ import annotations

from validation.hidden_effects.case_generator import (
    GRAM,
    MM,
    HiddenEffectCase,
    base_roll,
    base_warms,
    bending,
    bracket,
    cable,
    case,
    combined,
    coupled,
    gain,
    lag,
    leaning,
    named,
    play,
    restart,
    shaft,
    slip,
    spring,
    stretched,
    warms,
)
from validation.synthetic import EntangledJoint, FastClock, WrongBody, WrongLoad

NOTHING = HiddenEffectCase("nothing", (), lambda *_: ())
SINGLE = named(
    play(2, 1.2, 0.04),
    play(3, 1.6, 0.03),
    play(4, 1.6, 0.02),
    lag(1, 1.0),
    lag(3, 1.2),
    gain(1, 1, 0.02),
    gain(4, -1, 0.025),
    case("clock", "common_gain@servos", lambda by: FastClock(by.sign() * by.size(0.002), 2.6)),
    shaft(2, 0.015),
    shaft(5, 0.05),
    spring(1, 0.006, 0.15),
    spring(2, 0.005, 0.15),
    cable(1, -80.0, 0.05),
    cable(4, -70.0, 0.06),
    coupled(3, 2, 0.02),
    coupled(5, 4, 0.03),
    bending(2, 0.1, 6.0, 12.0),
    bending(4, 0.1, 1.5, 3.5),
    case("base-roll", "base_compliance@base", base_roll),
    case("load", "payload@tool", lambda by: WrongLoad(by.size(15.0 * GRAM))),
    case("load-hung", "payload@tool", lambda by: WrongLoad(by.size(10.0 * GRAM), (0.01, 0.0, by.size(25.0 * MM)))),
    case("heavy5", "mass@link5", lambda by: WrongBody("link 5", by.size(0.35))),
    bracket(2, 10.0),
    bracket(4, 10.0),
    warms(2, 0.7),
    warms(4, 1.1),
    case("warm-base", "drift@base", base_warms),
    slip(2, 0.6),
    slip(4, 1.0),
    restart(1, 3, 0.6),
    restart(3, 2, 0.8),
    case("stretched", "measurement_frame@frame", stretched),
    case("leaning", "measurement_frame@frame", leaning),
)
DOUBLE = named(
    combined(SINGLE["play2"], SINGLE["gain1"]),
    combined(SINGLE["warm2"], SINGLE["coupled3-2"]),
    combined(SINGLE["load"], SINGLE["lag1"]),
    combined(SINGLE["bending2"], SINGLE["shaft5"]),
    combined(SINGLE["stretched"], SINGLE["play3"]),
    combined(SINGLE["spring2"], SINGLE["restart1"]),
)
TRIPLE = named(
    combined(SINGLE["play2"], SINGLE["warm-base"], SINGLE["gain4"]),
    combined(SINGLE["bending4"], SINGLE["load"], SINGLE["lag3"]),
    combined(SINGLE["stretched"], SINGLE["coupled3-2"], SINGLE["shaft5"]),
)
OUTSIDE = named(
    case("sum-q1-q4", None, lambda by: EntangledJoint(3, (1, 4), by.size(0.02), "sum")),
    case("product-q1-q4", None, lambda by: EntangledJoint(3, (1, 4), by.size(0.025), "product")),
    case("beat-q3-q5", None, lambda by: EntangledJoint(2, (3, 5), by.size(0.015), "beat")),
)
CASES = named(NOTHING) | SINGLE | DOUBLE | TRIPLE | OUTSIDE

__all__ = ["CASES", "DOUBLE", "NOTHING", "OUTSIDE", "SINGLE", "TRIPLE", "HiddenEffectCase"]
