"""A hidden SO-101 with dead time, friction and play in its joints that follows a hand by the plug-in's commands.

It follows the requests themselves, the corrected commands, and those that are led by the dead times too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import count

import numpy as np

from lerobot_robot_lrm.corrected_arm import CorrectedArm
from lerobot_robot_lrm.correction import Correction
from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.place_names import joint_number
from lrm_math.arrays import Array
from lrm_math.effects.reference import ParameterRef
from lrm_math.model.model import model_of
from lrm_math.motion.motion_model import MotionModel, effect_of
from validation.lerobot_dataset import FPS
from validation.motion.world import JOINTS, TrueJoints, driven

WAYS = ("requests", "corrected", "led")
VALUES = (
    ("servo_response", "frequency_Hz"), ("servo_response", "damping_ratio"), ("dead_time", "t_s"),
    ("coulomb_friction", "c_rad"), ("motion_play", "b_rad"),
)  # fmt: skip
STOPPED_FRAMES, STOPPED_RAD = 10, np.radians(0.5)
"""A request is at a stop where it stayed this near for so many frames."""


@dataclass(frozen=True)
class TrackingErrors:
    """deg RMS of the encoders about the requests, by way of `WAYS`: over all frames and at stops; deg, how far a joint
    went beyond the range of its requests at most."""

    everywhere: dict[str, float]
    at_stops: dict[str, float]
    beyond: dict[str, float]


def hidden_arm(rng: np.random.Generator) -> TrueJoints:
    """An SO-101 whose servos act late, two of which rub, and one has play that its encoder shows."""
    friction, play = np.zeros(JOINTS), np.zeros(JOINTS)
    rubs = rng.permutation(JOINTS)
    friction[rubs[:2]], play[rubs[2]] = rng.uniform(0.01, 0.03, 2), rng.uniform(0.02, 0.05)
    return TrueJoints(
        frequency_hz=rng.uniform(3.0, 6.0, JOINTS), damping=rng.uniform(0.6, 1.2, JOINTS),
        dead_time=rng.uniform(0.02, 0.08, JOINTS), friction=friction, play=play,
    )  # fmt: skip


def commands(correction: Correction, wishes: Array) -> Array:
    """(N, n), rad, that the plug-in sends for requests (N, n), rad, `FPS` a second."""
    arm = CorrectedArm("none", correction)
    arm.scale, out = np.ones(wishes.shape[1]), list[list[float]]()
    arm.clock = partial(next, count(0.0, 1.0 / FPS))
    start = _action(arm, wishes[0])
    for wish in wishes:
        asked_for = arm.corrected(_action(arm, wish), lambda: start)
        arm.follow(asked_for, asked_for.action)
        out.append([asked_for.action[key] for key in arm.keys])
    return np.array(out)


def _action(arm: CorrectedArm, wish: Array) -> Mapping[str, float]:
    return dict(zip(arm.keys, wish.tolist(), strict=True))


def tracking(hidden: TrueJoints, motion: MotionModel, wishes: Array, rng: np.random.Generator) -> TrackingErrors:
    """Errors of a hidden arm that follows requests (N, 5), rad, in each of the ways."""
    corrected = Correction.of(model_of(motion.arm, ())).in_motion(motion)
    told = np.stack([wishes, commands(corrected, wishes), commands(corrected.led_by(motion), wishes)])
    made = driven([hidden] * len(WAYS), told[None], rng)
    off = {way: np.degrees(wishes) - one.state for way, one in zip(WAYS, made, strict=True)}
    frames = np.lib.stride_tricks.sliding_window_view(wishes, STOPPED_FRAMES, axis=0)
    stopped = np.ptp(frames, axis=-1) < STOPPED_RAD
    low, high = np.degrees(wishes.min(axis=0)), np.degrees(wishes.max(axis=0))
    return TrackingErrors(
        {way: _rms(error) for way, error in off.items()},
        {way: _rms(error[STOPPED_FRAMES - 1 :][stopped]) for way, error in off.items()},
        {way: float(np.maximum(low - one.state, one.state - high).max()) for way, one in zip(WAYS, made, strict=True)},
    )


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def motion_model_with(stated: Mapping[str, float]) -> MotionModel:
    """A model of motion of an SO-101 with effects at its joints, by the values of parameters, those of servos too."""
    model = MotionModel.nominal(load_arm("so101"))
    for place in sorted({ParameterRef.parse(key).place for key in stated}):
        here = {key: value for key, value in stated.items() if ParameterRef.parse(key).place == place}
        own = model.of_joint(joint_number(place))
        names = dict.fromkeys(str(ParameterRef.parse(key).effect) for key in here)
        more = (effect_of(model.arm, name) for name in names if name not in {effect.name for effect in own})
        values = {key: value for key, value in model.values.items() if ParameterRef.parse(key).place == place}
        model = model.with_joint([*own, *more], values | here, {})
    return model


def known_motion(hidden: TrueJoints) -> MotionModel:
    """The model of motion with a hidden arm's values."""
    sizes = (hidden.frequency_hz, hidden.damping, hidden.dead_time, hidden.friction, hidden.play)
    stated = {
        str(ParameterRef(kind, f"joint{j}", name)): value
        for j, row in enumerate(np.array(sizes).T.tolist(), 1)
        for (kind, name), value in zip(VALUES, row, strict=True)
    }
    return motion_model_with(stated)
