"""What the tool answers to a hidden cause of motion, and whether that is right."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.measuring.motion.moves import moves_of
from lrm_ident.measuring.recordings.lerobot import LeRobotFrames
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import EffectRef
from validation.encoder_checkup.teleoperation import Recording
from validation.motion.cases import MotionCase, truth_of
from validation.motion.world import TrueJoints


@dataclass(frozen=True)
class MotionOutcome:
    """Answer to one case.

    Attributes:
        named: identified causes; rest: other effects of the model, with their kind and rivals.
        verdict: right (the cause is identified, or it is in the class that is named), honest (no cause identified, and
            none there is, or the error that stays is said), missed (nothing wrong, but the cause is there and the model
            claims to be complete), false (an identified cause that is not there).
        before, after, noise: held-out error of the joint where the cause hides (deg RMS), and the noise of a reading.
        inside: how many of the known parameters' 95 % intervals hold the truth, and of how many.
    """

    case: str
    joint: int
    named: tuple[str, ...]
    rest: tuple[str, ...]
    verdict: str
    before: float
    after: float
    noise: float
    inside: tuple[int, int]
    seconds: float


def answered(case: MotionCase, arm: TrueJoints, joint: int, made: Recording) -> MotionOutcome:
    """Runs `auto` on the recording of a case."""
    begun = time.monotonic()
    frames = LeRobotFrames(np.radians(made.action), np.radians(made.state), made.t, made.episode)
    start = MotionStudy.of(moves_of(frames, load_arm("so101"), Path(case.name))).fit()
    study = start.auto()
    judged = study.judged()
    place = f"joint{joint + 1}"
    right = {f"{kind}@{place}" for kind in case.true}
    named = tuple(one.effect.name for one in judged if one.identified)
    rest = tuple(
        f"{one.effect.name}: {one.kind}{' or ' + ', '.join(one.rivals) if one.rivals else ''}"
        for one in judged
        if not one.identified
    )
    in_class = {name for one in judged for name in (one.effect.name, *one.rivals)}
    after, noise = study.fits[joint].held_out_rms, float(study.moves.noise[joint])
    if set(named) - right:
        verdict = "false"
    elif not right:
        verdict = "honest"
    elif right & in_class:
        verdict = "right"
    else:
        verdict = "honest" if after > 1.2 * noise else "missed"
    truth, inside = truth_of(case, arm, joint), []
    for key, value in truth.items():
        if key in study.model.values and study.model.sigma.get(key, 0.0) > 0.0:
            kind, where, _ = key.split(".")
            sound = where != place or right & {effect.name for effect in study.model.added}
            if sound and EffectRef.parse(f"{kind}@{where}"):
                inside.append(abs(study.model.values[key] - value) <= 1.96 * study.model.sigma[key])
    before = start.fits[joint].held_out_rms
    degrees = [float(np.degrees(value)) for value in (before, after, noise)]
    return MotionOutcome(
        case.name, joint + 1, named, rest, verdict, *degrees, (int(sum(inside)), len(inside)), time.monotonic() - begun
    )
