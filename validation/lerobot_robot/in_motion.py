"""What the plug-in makes of a motion model: `python -m validation.lerobot_robot.in_motion [--seed N] [--arms N]`.

A hidden SO-101 (`validation.motion.world`) with dead time, friction and play in its joints is recorded once, and a
motion model with these effects is fitted to that. Then it follows another hand: by the requests themselves, by the
plug-in's commands, and by those with the path announced.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lerobot_robot_lrm.corrected_arm import CorrectedArm
from lerobot_robot_lrm.correction import Correction
from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.measuring.motion.moves import moves_of
from lrm_ident.measuring.recordings.lerobot import LeRobotFrames
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.model.model import model_of
from lrm_math.motion.motion_model import MotionModel
from validation.lerobot_dataset import FPS
from validation.motion.world import JOINTS, TrueJoints, driven, hand, recorded
from validation.options import asked
from validation.runner import run_cases

WAYS = ("requests", "corrected", "announced")
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


def commands(motion: MotionModel, wishes: Array, announced: bool) -> Array:
    """(N, n), rad, that the plug-in sends for requests (N, n), rad, of an arm whose poses have no error."""
    arm = CorrectedArm("none", Correction.of(model_of(motion.arm, ())).in_motion(motion))
    arm.scale, out = np.ones(motion.arm.dof), []
    actions = [_action(arm, wish) for wish in wishes]
    if announced:
        arm.announce(actions, FPS)
    for action in actions:
        asked_for = arm.corrected(action, lambda: actions[0])
        arm.follow(asked_for, asked_for.action)
        out.append([asked_for.action[key] for key in arm.keys])
    return np.array(out)


def _action(arm: CorrectedArm, wish: Array) -> Mapping[str, float]:
    return dict(zip(arm.keys, wish.tolist(), strict=True))


def tracking(hidden: TrueJoints, motion: MotionModel, wishes: Array, rng: np.random.Generator) -> TrackingErrors:
    """Errors of a hidden arm that follows requests (N, 5), rad, in each of the ways."""
    told = {"requests": wishes} | {way: commands(motion, wishes, way == "announced") for way in WAYS[1:]}
    made = driven([hidden] * len(WAYS), np.stack([told[way] for way in WAYS])[None], rng)
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


def fitted(hidden: TrueJoints, rng: np.random.Generator) -> MotionModel:
    """A model of motion of one recording, with the effects that the arm has."""
    made = recorded([hidden], rng)[0]
    frames = LeRobotFrames(np.radians(made.action), np.radians(made.state), made.t, made.episode)
    study = MotionStudy.of(moves_of(frames, load_arm("so101"), Path("made"))).fit()
    there = {"dead_time": hidden.dead_time, "coulomb_friction": hidden.friction, "motion_play": hidden.play}
    for effect, sizes in there.items():
        for joint in np.flatnonzero(sizes):
            study = study.add(f"{effect}@joint{joint + 1}")
    return study.model


def examined(seed: int) -> TrackingErrors:
    """Of the arm of a seed."""
    rng = np.random.default_rng([64, seed])
    hidden = hidden_arm(rng)
    return tracking(hidden, fitted(hidden, rng), hand(rng), rng)


def _line(_key: str, one: TrackingErrors) -> str:
    parts = (
        f"{way}: {one.everywhere[way]:.2f} deg RMS, {one.at_stops[way]:.2f} at stops, {one.beyond[way]:.2f} beyond"
        for way in WAYS
    )
    return "; ".join(parts)


def main() -> None:
    """Prints a line for each arm."""
    chosen = asked(__doc__, seed=0, arms=3)
    seeds = {str(seed): seed for seed in range(chosen.seed, chosen.seed + chosen.arms)}
    for key, one in run_cases(seeds, examined, _line).items():
        print(f"seed {key}: {_line(key, one)}")


if __name__ == "__main__":
    main()
