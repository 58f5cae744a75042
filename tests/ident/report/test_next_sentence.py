"""What to measure next asks for nothing that the data hold already."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.report.diagnosis.conclusion import conclude
from lrm_math.model.derivatives import joint_levers
from lrm_math.model.equilibrium import solve_equilibrium
from tests.conftest import EXAMPLE

POSES, STEP_RAD, NOISE_M = 80, 4e-3, 3e-4


@pytest.mark.slow
def test_of_data_of_two_sessions_another_one_is_asked_for() -> None:
    """A step of joint 1 between two sessions is a sudden displacement, or a new zero: a third session tells."""
    data = lrm.load(EXAMPLE)
    fitted, part = lrm.Study.of(data).fit(), data.take(np.arange(POSES))
    second = np.arange(POSES) >= POSES // 2
    equilibrium = solve_equilibrium(fitted.model, part.poses)
    moved = STEP_RAD * second[:, None] * joint_levers(equilibrium)[0].T
    tcp = equilibrium.tcp + moved + np.random.default_rng(1).normal(0.0, NOISE_M, (POSES, 3))
    poses = replace(part.poses, session=second.astype(float), power_cycle=second.astype(int))
    found = lrm.Study.of(replace(part, poses=poses).with_tcp(tcp)).fit().diagnose()
    assert found.first is not None
    names = {found.first.scored.name, *found.first.equivalent}
    assert {"session@joint1", "change_point@joint1"} <= names
    add, *_, measure, repair = conclude(found).next
    assert add.commands[0].startswith("lrm-ident add "), "what needs no new poses comes first"
    assert measure.lead == "to learn the cause"
    assert "two or more sessions" not in measure.words
    assert "another session, with some of the same poses" in measure.words
    assert "find what moved" in repair.words
