"""What is said of an effect is what the daemon does about it: `on_rover` of every effect of the catalogue."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.report.effects import ON_ROVER, effect_blocks
from lrm_math.arrays import Array
from lrm_math.effects import ALL_EFFECTS, Effect, compensable, effects_at
from lrm_math.effects.servo_errors import Quantisation
from lrm_math.effects.session_errors import warms_with_the_arm
from lrm_math.ik.answer import Solved
from lrm_math.ik.goal import point
from lrm_math.kinematics.poses import Poses
from lrm_math.model.deployed_model import OnRover, on_rover
from lrm_math.model.equilibrium import solve_equilibrium, with_borne_loads
from lrm_math.model.model import Model, model_of
from lrm_math.model.state_after_session import state_after_session
from lrmd.config import Config, load_config
from lrmd.ik.deployed_model import DeployedModel
from lrmd.ik.service import IkService
from tests.support.daemon.in_memory_daemon import CONFIG

SAME, APART = 1e-9, 1e-6
"""m: tips that agree, and that do not."""
COUNT, EARLY, PACE_S, LOAD_G = 30, 4, 60.0, 60.0
SIZE, MOST = 0.3, 100
"""Of a parameter, over its typical size; how many there are, for inverse kinematics have room for so much."""


@lru_cache
def config() -> Config:
    return load_config(CONFIG)


def examples() -> list[Effect]:
    """Each effect, at one place for each treatment: at joint 2, which bears a load, where it can act there."""
    arm, found = config().arm, dict[tuple[str, OnRover], Effect]()
    for kind in ALL_EFFECTS:
        for place in sorted(kind.places(arm), key=lambda place: "joint2" not in place):
            one = kind(arm, place)
            found.setdefault((one.id, on_rover(one)), one)
    return [*found.values()]


def session(folder: Path, sessions: int) -> Poses:
    """Poses in the order measured, under one load, in sessions of equal length."""
    rng = np.random.default_rng(3)
    q = np.degrees(rng.uniform(-0.5, 0.5, (COUNT, config().arm.dof)))
    head = ["pose", "t_s", "session", "payload_g", *(f"q{j + 1}_deg" for j in range(q.shape[1]))]
    rows = [[i, PACE_S * i, 1 + i * sessions // COUNT, LOAD_G, *row] for i, row in enumerate(q.round(6).tolist(), 1)]
    path = folder / "poses.csv"
    path.write_text("\n".join(",".join(map(str, row)) for row in [head, *rows]), encoding="utf-8")
    return load_poses(path, config().arm)


def model_with(*effects: Effect) -> Model:
    """Springs, and effects of some size beside them, where no temperature is measured."""
    arm = config().arm
    beside = "offsets" if any(effect.id == "compliance" for effect in effects) else "compliance"
    of = model_of(arm, [*effects_at(arm, beside), *effects])
    sizes = [p.fixed if p.fixed is not None else SIZE * p.typical * ("per_K" not in p.name) for p in of.parameters]
    sizes[MOST:] = [0.0] * len(sizes[MOST:])
    return of.with_values(np.array(sizes))


class DrivenSession:
    """A session of an arm with one effect, and the daemon at its last pose; where it follows the effect, at an early
    one, whose state is another."""

    def __init__(self, effect: Effect, folder: Path) -> None:
        poses = session(folder, 2 if "session" in effect.depends_on else 1)
        self.model = model_with(effect)
        poses = with_borne_loads(self.model, poses)
        warming = [effect.name] if warms_with_the_arm(effect) else []
        self.state = state_after_session(solve_equilibrium(self.model, poses), None, warming)
        follows = on_rover(effect) in (OnRover.WARMING, OnRover.REMEMBERED)
        self.now = poses.take(np.array([EARLY if follows else COUNT - 1]))
        self.unknown = Poses(self.now.q, self.now.payload, self.now.direction, friction=self.now.friction)
        left_out = () if compensable(effect) else (effect.id,)
        model = self.model if self.state is None else self.model.with_state(self.state)
        self.service = IkService.of(config(), DeployedModel(model, None, "", "sha", left_out))

    def true_tip(self) -> Array:
        return solve_equilibrium(self.model, self.now).true_tcp[0]

    def without_it(self) -> Array:
        return solve_equilibrium(model_with(), self.unknown).true_tcp[0]

    def driven(self, now: Poses) -> Array:
        """The tip that the daemon predicts where this is known of the pose."""
        return np.array(self.service.at(now).solver.predicted(self.unknown).tcp)


def apart(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a - b))


@pytest.mark.parametrize("effect", examples(), ids=lambda effect: effect.name)
def test_the_daemon_does_what_is_said(effect: Effect, tmp_path: Path) -> None:
    arm = DrivenSession(effect, tmp_path)
    true, known, unknown = arm.true_tip(), arm.driven(arm.now), arm.driven(arm.unknown)
    match on_rover(effect):
        case OnRover.COMPENSATED:
            assert apart(unknown, true) < SAME
            assert apart(true, arm.without_it()) > APART or effect.id in ("offsets", "compliance")
        case OnRover.ROUNDED:
            assert apart(unknown, arm.without_it()) < SAME
            assert apart(unknown, true) > APART
        case OnRover.WARMING | OnRover.REMEMBERED:
            assert apart(known, true) < 10 * SAME
            assert apart(unknown, true) > APART
            assert effect.id not in arm.service.deployed.uncompensated
        case OnRover.CARRIED:
            assert apart(known, unknown) < SAME
            if arm.state.carried[effect.name] == "last":
                assert apart(unknown, true) < SAME
            assert effect.id in arm.service.deployed.uncompensated
        case OnRover.LEFT_OUT:
            assert apart(known, unknown) < SAME
            assert arm.state is None or all(key.startswith("offsets.base.") for key in arm.state.offsets)
            assert effect.id in arm.service.deployed.uncompensated


def test_commands_are_rounded_as_the_effect_says(tmp_path: Path) -> None:
    (effect,) = effects_at(config().arm, Quantisation.id)
    arm = DrivenSession(effect, tmp_path)
    goal, plain = arm.without_it(), model_with()
    near = arm.now.q[0].tolist()
    answers = [IkService.of(config(), DeployedModel(of, None, "", "sha", ())) for of in (arm.model, plain)]
    with_it, without = (of.solver.solve(point(goal), LOAD_G * 1e-3, near) for of in answers)
    assert isinstance(with_it, Solved)
    assert isinstance(without, Solved)
    assert with_it.q == pytest.approx(without.q, abs=1e-12)
    there = solve_equilibrium(plain, Poses(np.array([with_it.rounded.q]), arm.now.payload, arm.now.direction))
    assert with_it.rounded.error == pytest.approx(math.dist(there.true_tcp[0], goal), abs=SAME)
    assert with_it.rounded.error > APART


@pytest.mark.parametrize("kind", ALL_EFFECTS, ids=lambda kind: kind.id)
def test_the_word_shown_is_the_treatment(kind: type[Effect]) -> None:
    shown = " ".join(map(str, effect_blocks(kind, in_full=True)))
    arm = load_config(CONFIG).arm
    treatments = {on_rover(kind(arm, place)) for place in kind.places(arm)}
    assert {of for of, words in ON_ROVER.items() if words in shown} == treatments
