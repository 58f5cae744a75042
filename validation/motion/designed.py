"""Designed moves against random ones: which of two causes is there? `python -m validation.motion.designed`

For pairs of causes that look alike one of them hides in the independent world's arm, at joint 2. It makes twelve random
moves, or the twelve that `motion design` chooses from a model that was fitted to random ones; each as long, and no
faster than 30 deg/s. The diagnosis then tries both. A pair is told where it names the hidden cause, and not the other.
Pairs of `FIRST` were looked at while the design was made, those of `LATER` were written after it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lrm_ident.measuring.excitation.excitations import ExcitingMove, as_moves, ramp_speeds, random_moves, rules_of
from lrm_ident.measuring.excitation.motion_design import MotionDesign, MotionDesignTask, motion_design
from lrm_ident.measuring.motion.joint_fit import JointFit, fit_joint
from lrm_ident.measuring.motion.moves import Moves, moves_of
from lrm_ident.measuring.motion.screening import screen_joint
from lrm_ident.measuring.recordings.lerobot import LeRobotFrames
from lrm_math.arm.arm_file import load_arm
from lrm_math.motion.base import MotionEffect
from lrm_math.motion.motion_model import MotionModel, effect_of
from validation.encoder_checkup.teleoperation import Recording
from validation.motion.world import TrueJoints, driven
from validation.options import asked

JOINT, MOVES, NOISE = 1, 12, float(np.radians(0.045))
ARM = load_arm("so101")
Hide = Callable[[TrueJoints], None]


def _put(**values: float) -> Hide:
    def hide(arm: TrueJoints) -> None:
        for name, value in values.items():
            getattr(arm, name)[JOINT] = value

    return hide


CAUSES: dict[str, Hide] = {
    "dead_time": _put(dead_time=0.03),
    "acceleration_limit": _put(acceleration=20.0),
    "velocity_feedforward": _put(lead=0.02),
    "coulomb_friction": _put(friction=0.01),
    "motion_play": _put(play=0.02),
    "swing": _put(second_hz=5.0, second_damping=0.05),
    "speed_limit": _put(speed=3.0),
    "drive_limit": _put(drive=0.2),
    "load_friction": _put(load_friction=0.02),
    "stribeck": _put(stiction=0.01),
}
"""With the catalogue's typical sizes."""
FIRST = (
    ("dead_time", "velocity_feedforward"),
    ("dead_time", "acceleration_limit"),
    ("coulomb_friction", "motion_play"),
    ("swing", "dead_time"),
    ("speed_limit", "drive_limit"),
)
LATER = (
    ("velocity_feedforward", "acceleration_limit"),
    ("swing", "velocity_feedforward"),
    ("load_friction", "motion_play"),
    ("stribeck", "coulomb_friction"),
    ("speed_limit", "acceleration_limit"),
)


@dataclass(frozen=True)
class HiddenCause:
    """One of a pair, which is hidden, and the other."""

    written: str
    cause: str
    rival: str

    @property
    def effects(self) -> tuple[MotionEffect, MotionEffect]:
        """Both in the catalogue."""
        place = f"joint{JOINT + 1}"
        return effect_of(ARM, f"{self.cause}@{place}"), effect_of(ARM, f"{self.rival}@{place}")


def recordings(
    hidden: Sequence[HiddenCause], moves: Sequence[Sequence[ExcitingMove]], rng: np.random.Generator
) -> list[Moves]:
    """What each arm did in moves of its own."""
    arms = [TrueJoints() for _ in hidden]
    for arm, one in zip(arms, hidden, strict=True):
        CAUSES[one.cause](arm)
    told = np.stack([as_moves(ARM, own, NOISE, smooth=False).command for own in moves], axis=1)
    return [moves_of(frames_of(made), ARM, Path()) for made in driven(arms, told, rng)]


def frames_of(made: Recording) -> LeRobotFrames:
    """As read from a dataset."""
    return LeRobotFrames(np.radians(made.action), np.radians(made.state), made.t, made.episode.astype(np.int64))


def base_fit(moves: Moves) -> JointFit:
    """The servo's response alone, of the joint."""
    model = MotionModel.nominal(ARM)
    return fit_joint(model.of_joint(JOINT), moves.measured(model, [JOINT])[0], {})


def told(fit: JointFit, moves: Moves, one: HiddenCause) -> bool:
    """Whether the diagnosis names the cause, and not its rival."""
    kinds = tuple(type(effect) for effect in (*fit.effects, *one.effects))
    found = screen_joint(fit, float(moves.noise[JOINT]), kinds, 2)
    cause, rival = (effect.name for effect in one.effects)
    return found.first is not None and found.first.effect.name == cause and rival not in found.equivalent


def designed(fit: JointFit, one: HiddenCause, seed: int) -> MotionDesign:
    """Moves for both causes, from a model that was fitted to other moves."""
    model = MotionModel.nominal(ARM).with_joint(fit.effects, fit.by_key, fit.sigma)
    return motion_design(MotionDesignTask(model, one.effects, MOVES, NOISE, by_tip=False, seed=seed))


def main() -> None:
    """Prints one line for each pair and each of its causes."""
    given = asked(__doc__, seed=0, json=None)
    rng = np.random.default_rng(given.seed)
    hidden = [
        HiddenCause(when, *pair)
        for when, pairs in (("first", FIRST), ("later", LATER))
        for a, b in pairs
        for pair in ((a, b), (b, a))
    ]
    speeds, rules = ramp_speeds(ARM), rules_of(ARM)
    usual = recordings(hidden, [random_moves(ARM, MOVES, speeds, rules, rng) for _ in hidden], rng)
    before = [base_fit(moves) for moves in usual]
    designs = [designed(before[k - k % 2], hidden[k - k % 2], given.seed) for k in range(0, len(hidden), 2)]
    designs = [design for design in designs for _ in range(2)]
    made = recordings(hidden, [design.moves for design in designs], rng)
    rows = []
    for one, random, fit, design, moves in zip(hidden, usual, before, designs, made, strict=True):
        promised = next(pair.told for pair in design.pairs if pair.effect.startswith(one.cause))
        answers = (told(fit, random, one), promised, told(base_fit(moves), moves, one))
        keys = ("random", "promised", "designed")
        rows.append(
            {"written": one.written, "cause": one.cause, "rival": one.rival, **dict(zip(keys, answers, strict=True))}
        )
        words = [f"{key} {'told' if answer else 'not told'}" for key, answer in zip(keys, answers, strict=True)]
        print(f"{one.written} {one.cause} beside {one.rival}: {', '.join(words)}", flush=True)
    for when in ("first", "later"):
        part = [row for row in rows if row["written"] == when]
        counts = [f"{key} {sum(bool(row[key]) for row in part)}" for key in ("random", "promised", "designed")]
        print(f"{when}, of {len(part)}: {', '.join(counts)}")
    if given.json:
        given.json.write_text(json.dumps({"seed": given.seed, "pairs": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
