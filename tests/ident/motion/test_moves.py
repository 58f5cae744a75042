"""Loads of a move are straight between its frames: held for a frame they would lag by half of one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lrm_ident.measuring.motion.moves import LEAD_S, LONGEST_LEAD_S, between, cut


def test_a_load_that_grows_evenly_is_that_of_the_middle_of_each_step() -> None:
    t = np.arange(6) / 30.0
    values = np.stack([2.0 * t, 1.0 - t])
    found = between(values, 4)
    middle = (np.arange(20) + 0.5) / 120.0
    np.testing.assert_allclose(found, np.stack([2.0 * middle, 1.0 - middle], axis=1), atol=1e-12)


def test_a_move_begins_where_the_arm_was_slow_before_its_readings_count() -> None:
    dt = 0.1
    unfit = np.ones(200)
    unfit[[60, 75, 120, 137]] = 0.0
    rows, counted = cut(Path("x"), dt, [(unfit, np.arange(200))] * 4, LONGEST_LEAD_S)
    first = rows[np.arange(len(rows)), np.argmax(counted, axis=1)]
    leads = first - rows[:, 0]
    assert len({*leads.tolist()}) > 1
    assert np.all((leads >= round(LEAD_S / dt)) & (leads <= round(LONGEST_LEAD_S / dt)))
    for begin, lead in zip(first, leads, strict=True):
        earlier = unfit[max(begin - round(LONGEST_LEAD_S / dt), 0) : begin - round(LEAD_S / dt) + 1]
        assert unfit[begin - lead] == earlier.min()
