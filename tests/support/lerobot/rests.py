"""Rests after straight moves to goals: near the last one (0.05 to 3° a joint), anywhere, the most singular of thirty.

Two equal arms with a history of their own: one is sent the bounded commands, the other the wishes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lerobot_robot_lrm.bounded import BoundedCommand, bounded_command
from lerobot_robot_lrm.correction import Correction
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import EffectRef, ParameterRef, effects_at
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics.motion import Motion
from lrm_math.model.model import Model, model_of
from tests.support.lerobot.small_steps import HELD, random_model

WORSE, LEAST_M = 1.05, 1e-5
"""The law: corrected ≤ 1.05 · uncorrected, and what a solver leaves."""
LAGGING = ("h_rad", "c_2deg_rad", "c_8deg_rad", "c_30deg_rad")
"""Ends of keys that are negative where a joint lags behind its motion."""
STEP, PATIENCE = np.radians(1.0), 60
DIRECTED = ("backlash", "hysteresis", "friction_curve")
KINDS = ("near", "anywhere", "singular")
NUDGE, CANDIDATES = 1e-6, 30


@dataclass(frozen=True)
class RestErrors:
    """Distance of the tip from its goal at one rest, with and without correction (m)."""

    kind: str
    corrected: float
    uncorrected: float

    @property
    def worse(self) -> bool:
        """Whether the law is broken."""
        return self.corrected > WORSE * self.uncorrected + LEAST_M


def lagging_model(arm: Arm, rng: np.random.Generator) -> Model:
    """A model with play and friction on most joints, all of it lagging, and on half of the arms offsets and springs."""
    names = ["offsets", "compliance"] if rng.random() < 0.5 else ["compliance"]
    names += [str(EffectRef(name, joint)) for joint in arm.joint_names for name in DIRECTED if rng.random() < 0.4]
    whole = random_model(arm, rng)
    effects = [effect for name in names for effect in effects_at(arm, name)]
    keys = [key for effect in effects for key in effect.keys if ParameterRef.parse(key).effect not in HELD]
    known = dict(zip(whole.keys, whole.values.tolist(), strict=True))
    values = {
        key: known[key] if key in known else 0.01 * float(rng.normal())
        for key in keys
        if key in known or _of_motion(key)
    }
    return as_lag(model_of(arm, effects, values))


def as_lag(model: Model) -> Model:
    """A model whose friction lags, however it was drawn."""
    ends = [ParameterRef.parse(key).name for key in model.keys]
    values = zip(ends, model.values.tolist(), strict=True)
    return model.with_values([-abs(x) if end in LAGGING else abs(x) if end == "b_rad" else x for end, x in values])


def rests(made: Correction, seed: int, count: int) -> Iterator[RestErrors]:
    """Errors at so many rests of the exact model's arm."""
    rng = np.random.default_rng([65, seed])
    low, high = made.limits
    q = rng.uniform(low, high)
    sent = plain = Motion.at(q)
    before: BoundedCommand | None = None
    for number in range(count):
        kind = KINDS[number % len(KINDS)]
        goal = _goal(made, kind, q, rng)
        for wish in _moves(q, goal):
            before = bounded_command(made, wish, sent, before)
            sent, plain = sent.to(before.command), plain.to(wish)
        for _ in range(PATIENCE):
            answer = bounded_command(made, goal, sent, before)
            still = before is not None and np.array_equal(answer.command, before.command)
            sent, before = sent.to(answer.command), answer
            if still:
                break
        q = goal
        try:
            aim = tip(made, q, None)
            yield RestErrors(kind, *(float(np.linalg.norm(tip(made, m.q, m) - aim)) for m in (sent, plain)))
        except NoEquilibrium:
            continue


def _goal(made: Correction, kind: str, q: Array, rng: np.random.Generator) -> Array:
    low, high = made.limits
    if kind == "near":
        return np.asarray(np.clip(q + np.radians(rng.uniform(0.05, 3.0)) * rng.uniform(-1, 1, len(q)), low, high))
    if kind == "anywhere":
        return np.asarray(rng.uniform(low, high))
    return min(rng.uniform(low, high, (CANDIDATES, len(q))), key=lambda each: _least_singular(made, each))


def _least_singular(made: Correction, q: Array) -> float:
    """Smallest singular value (m/rad) of the position of the arm as drawn."""
    tips = np.array([tip(made, each, None) for each in (q, *(q + NUDGE * np.eye(len(q))))])
    return float(np.linalg.svd((tips[1:] - tips[0]).T / NUDGE, compute_uv=False)[-1])


def tip(made: Correction, q: Array, motion: Motion | None) -> Array:
    """(3,), tip (m) of the real arm whose encoders read q (n,), rad, after a motion; None: of the arm as drawn."""
    if motion is None:
        return np.asarray(made.drawn.kernel.forward(made.drawn.slots_at(q)[None])[0][0, :3, 3])
    return np.asarray(made.arm.kernel.forward(made.arm.settled(q, motion)[None])[0][0, :3, 3])


def _moves(q: Array, goal: Array) -> Array:
    """(N, n), rad, wishes straight from q to a goal (n,)."""
    count = max(1, int(np.ceil(np.abs(goal - q).max() / STEP)))
    return np.asarray(q + np.linspace(0.0, 1.0, count + 1)[1:, None] * (goal - q))


def _of_motion(key: str) -> bool:
    return ParameterRef.parse(key).name in (*LAGGING, "b_rad", "k_rad_per_Nm")
