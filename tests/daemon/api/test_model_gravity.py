"""The model in use under a known direction of gravity: guard, torques and the ik process follow it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from lrmd.api.model_reload import ActiveModel
from lrmd.config import load_config
from lrmd.ramp.shared_memory import GravityRecord, SharedRecords
from lrmd.safety.collision_guard import CollisionGuard
from tests.conftest import TABLE_B2
from tests.support.daemon.in_memory_daemon import CONFIG

pytestmark = pytest.mark.long

DOWN = (math.sin(0.2), 0.0, -math.cos(0.2))


def test_the_guard_checks_the_arm_as_it_bends_there() -> None:
    shared = SharedRecords.create()
    active = ActiveModel(replace(load_config(CONFIG), model=TABLE_B2), shared)
    level, q = active.guard, np.random.default_rng(0).uniform(-1.0, 1.0, (20, 6))
    assert isinstance(level, CollisionGuard)
    assert shared.read_gravity() is None
    active.under_gravity(DOWN)
    tilted = active.guard
    assert isinstance(tilted, CollisionGuard)
    assert shared.read_gravity() == GravityRecord(True, *DOWN)
    assert active.gravity == pytest.approx([9.81 * x for x in DOWN])
    assert tilted.model.constant_gravity == pytest.approx([9.81 * x for x in DOWN])
    apart = tilted.separation(q, 0.1) - level.separation(q, 0.1)
    assert np.abs(apart).max() > 1e-4
    active.load()
    assert isinstance(active.guard, CollisionGuard)
    assert active.guard.model.constant_gravity == tilted.model.constant_gravity
    active.under_gravity(None)
    assert shared.read_gravity() == GravityRecord()
    assert active.gravity == active.deployed.model.arm.gravity
