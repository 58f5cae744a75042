"""The catalogue of effects that have names: which are hidden, and what the tool should name them."""

from __future__ import annotations

from validation.hidden_effects import causes
from validation.hidden_effects.case import GRAM, MM, NAMED, by_key, hidden, nothing, together
from validation.synthetic import FastClock, FormulaJoint, WrongBody, WrongLoad

NOTHING = nothing(NAMED)
SINGLE = by_key(
    causes.play(2, 1.2, 0.04),
    causes.play(3, 1.6, 0.03),
    causes.play(4, 1.6, 0.02),
    causes.lag(1, 1.0),
    causes.lag(3, 1.2),
    causes.gain(1, 1, 0.02),
    causes.gain(4, -1, 0.025),
    hidden(NAMED, "clock", "common_gain@servos", lambda by: FastClock(by.sign() * by.size(0.002), 2.6)),
    causes.shaft(2, 0.015),
    causes.shaft(5, 0.05),
    causes.spring(1, 0.006, 0.15),
    causes.spring(2, 0.005, 0.15),
    causes.cable(1, -80.0, 0.05),
    causes.cable(4, -70.0, 0.06),
    causes.coupled(3, 2, 0.02),
    causes.coupled(5, 4, 0.03),
    causes.bending(2, 0.1, 6.0, 12.0),
    causes.bending(4, 0.1, 1.5, 3.5),
    hidden(NAMED, "base-roll", "base_compliance@base", causes.base_roll),
    hidden(NAMED, "load", "payload@tool", lambda by: WrongLoad(by.size(15.0 * GRAM))),
    hidden(
        NAMED,
        "load-hung",
        "payload@tool",
        lambda by: WrongLoad(by.size(10.0 * GRAM), (0.01, 0.0, by.size(25.0 * MM))),
    ),
    hidden(NAMED, "heavy5", "mass@link5", lambda by: WrongBody("link 5", by.size(0.35))),
    causes.bracket(2, 10.0),
    causes.bracket(4, 10.0),
    causes.warms(2, 0.7),
    causes.warms(4, 1.1),
    hidden(NAMED, "warm-base", "drift@base", causes.base_warms),
    causes.slip(2, 0.6),
    causes.slip(4, 1.0),
    causes.restart(1, 3, 0.6),
    causes.restart(3, 2, 0.8),
    hidden(NAMED, "stretched", "measurement_frame@frame", causes.stretched),
    hidden(NAMED, "leaning", "measurement_frame@frame", causes.leaning),
)
DOUBLE, TRIPLE = (
    by_key(*(together(*(SINGLE[part] for part in name.split("+"))) for name in names.split()))
    for names in (
        "play2+gain1 warm2+coupled3-2 load+lag1 bending2+shaft5 stretched+play3 spring2+restart1",
        "play2+warm-base+gain4 bending4+load+lag3 stretched+coupled3-2+shaft5",
    )
)
OUTSIDE = by_key(
    hidden(NAMED, "sum-q1-q4", None, lambda by: FormulaJoint(3, by.size(0.02), "np.sin(q[1] + q[4])")),
    hidden(NAMED, "product-q1-q4", None, lambda by: FormulaJoint(3, by.size(0.025), "np.sin(q[1]) * np.sin(q[4])")),
    hidden(NAMED, "beat-q3-q5", None, lambda by: FormulaJoint(2, by.size(0.015), "np.sin(2.0 * q[3]) * np.cos(q[5])")),
)
CASES = by_key(NOTHING) | SINGLE | DOUBLE | TRIPLE | OUTSIDE
