"""Straight paths of wishes in small steps over the whole range: how far commands step.

What LeRobot's robot does is done here without it: `bounded_command`, one wish after the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lerobot_robot_lrm.bounded import BoundedCommand, bounded_command
from lerobot_robot_lrm.correction import Correction
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import EffectRef, ParameterRef, effects_at
from lrm_math.kinematics.motion import Motion
from lrm_math.model.model import Model, model_of

LONGEST = 120
"""Steps of a path."""
SIZES = {
    "theta_rad": 0.02, "d_mm": 0.0015, "a_mm": 0.0015, "x_mm": 0.0015, "y_mm": 0.0015, "z_mm": 0.0015,
    "k_rad_per_Nm": 0.03, "k_x_rad_per_Nm": 0.01, "k_y_rad_per_Nm": 0.01, "g_plus_rad_per_rad": 0.02,
    "g_minus_rad_per_rad": 0.02, "b_rad": 0.02, "h_rad": 0.02, "c_2deg_rad": 0.006, "c_8deg_rad": 0.006,
    "c_30deg_rad": 0.006, "d_rad_per_Nm": 0.005,
}  # fmt: skip
"""Standard deviations of hidden parameters by the end of their key (SI); other angles of a placement, see `TWIST`."""
TWIST = 0.006
"""rad: 5 mrad and more of twist between axes are usual."""
HELD = {EffectRef("offsets", "base"), EffectRef("offsets", "tool")}
"""Where the arm and the tool are mounted: known."""
POSITIVE = {"k_rad_per_Nm", "k_x_rad_per_Nm", "k_y_rad_per_Nm", "b_rad"}
WHERE = (("servo_gain", 0.7), ("backlash", 0.5), ("hysteresis", 0.5), ("friction_curve", 0.3))
"""Effects that some joint has, with what probability."""


@dataclass
class PathFigures:
    """Largest figures along paths: a step of a command, and of a joint without direction over that of the wish; how far
    a command is from the wish and the zero offset (rad)."""

    undirected_ratio: float = 0.0
    largest_step: float = 0.0
    farthest: float = 0.0


def random_model(arm: Arm, rng: np.random.Generator) -> Model:
    """A model with offsets, twists and springs, and on random joints gains, backlash, hysteresis and friction."""
    names = ["offsets", "compliance", *(["base_compliance"] if rng.random() < 0.5 else [])]
    chosen = (name for name, share in WHERE if rng.random() < share)
    names += [str(EffectRef(name, f"joint{rng.integers(1, arm.dof + 1)}")) for name in chosen]
    effects = [effect for name in names for effect in effects_at(arm, name)]
    keys = [key for effect in effects for key in effect.keys if ParameterRef.parse(key).effect not in HELD]
    return model_of(arm, effects, {key: _value(key, rng) for key in keys if _size(key)})


def random_path(low: Array, high: Array, rng: np.random.Generator) -> Array:
    """(N, n), rad, wishes straight from one random pose towards another, by 0.1 to 1 degree of the fastest joint."""
    start, way = rng.uniform(low, high), rng.uniform(low, high)
    way = way - start
    step, far = np.radians(rng.uniform(0.1, 1.0)), np.abs(way).max()
    return np.asarray(start + np.outer(np.arange(min(LONGEST, int(far / step)) + 1) * step / far, way))


def follow(made: Correction, path: Array, found: PathFigures) -> Array:
    """(N, n), commands (rad) along one path (N, n), rad; adds what happens there."""
    motion, before, sent = Motion.at(path[0]), None, []
    for wish in path:
        answer = bounded_command(made, wish, motion, before)
        found.farthest = max(found.farthest, float(np.abs(answer.command - answer.wish - made.zero_shift).max()))
        if before is not None:
            _add_step(made, before, answer, found)
        motion, before = motion.to(answer.command), answer
        sent.append(answer.command)
    return np.array(sent)


def _add_step(made: Correction, before: BoundedCommand, answer: BoundedCommand, found: PathFigures) -> None:
    steps, wished = np.abs(answer.command - before.command), float(np.abs(answer.wish - before.wish).max())
    if wished < 1e-6:  # beyond the limits
        return
    found.largest_step = max(found.largest_step, float(steps.max()))
    plain = steps[made.slack == 0.0]
    found.undirected_ratio = max([found.undirected_ratio, *(plain / wished).tolist()])


def _size(key: str) -> float:
    effect, _, name = ParameterRef.parse(key)
    return SIZES.get(name, TWIST if effect == "offsets" and name.endswith("_rad") else 0.0)


def _value(key: str, rng: np.random.Generator) -> float:
    value = float(rng.normal(0.0, _size(key)))
    return abs(value) if ParameterRef.parse(key).name in POSITIVE else value
