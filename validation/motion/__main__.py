"""Hidden effects of motion, one table: `python -m validation.motion [--arm A] [--seed N] [--only WORD] [--json FILE]`.

An so101 is recorded by its encoders, an lrm-rover by a tracker of its tip.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.measuring.motion.moves import Moves, moves_of
from lrm_ident.measuring.motion.tip_moves import tip_moves
from lrm_ident.measuring.recordings.command_log import CommandLog
from lrm_ident.measuring.recordings.lerobot import LeRobotFrames
from lrm_ident.measuring.recordings.take import TipTrack
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import EffectRef, ParameterRef
from lrm_math.model.model import model_of
from lrm_math.motion.effects import RestOffset
from validation.lerobot_dataset import Recording, write_dataset
from validation.motion.cases import FIRST, LATER, MotionCase, arm_of, truth_of
from validation.motion.tracked import toured
from validation.motion.world import TrueJoints, recorded
from validation.options import asked
from validation.runner import NO_CASE, json_text, refuse, run_cases


@dataclass(frozen=True)
class MotionOutcome:
    """Answer to one case.

    Attributes:
        named: identified causes; rest: other effects of the model, with their kind and rivals.
        verdict: right (the cause is identified, or it is in the class that is named), honest (no cause identified, and
            none there is, or the error that stays is said), missed (nothing wrong, but the cause is there and the model
            claims to be complete), false (an identified cause that is not there).
        before, after, noise: held-out error of the joint where the cause hides, or of the tip, and the noise of a
            reading, in `unit` RMS.
        off: of the known parameters, by key: value less truth in its standard errors.
    """

    case: str
    joint: int
    named: tuple[str, ...]
    rest: tuple[str, ...]
    verdict: str
    before: float
    after: float
    noise: float
    off: dict[str, float]
    seconds: float
    unit: str = "deg"

    @property
    def inside(self) -> tuple[int, int]:
        """How many of the 95 % intervals hold the truth, and of how many."""
        return sum(abs(off) <= 1.96 for off in self.off.values()), len(self.off)


Made = Recording | tuple[CommandLog, TipTrack]
"""What encoders or a tracker recorded beside the commands."""


def moves_in(made: Made, name: str) -> Moves:
    """As the program reads them."""
    if isinstance(made, Recording):
        frames = LeRobotFrames(np.radians(made.action), np.radians(made.state), made.t, made.episode)
        return moves_of(frames, load_arm("so101"), Path(name))
    return tip_moves(*made, model_of(load_arm("lrm-rover"), ()))


def answered(case: MotionCase, arm: TrueJoints, joint: int, made: Made) -> MotionOutcome:
    """Runs `auto` on the recording of a case."""
    begun = time.monotonic()
    start = MotionStudy.of(moves_in(made, case.name)).fit()
    study = start.auto()
    judged = study.judged()
    place = f"joint{joint + 1}"
    right = {str(EffectRef(kind, place)) for kind in case.true}
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
    off = {}
    for key, value in truth_of(case, arm, joint).items():
        if study.moves.unit == "mm" and ParameterRef.parse(key).id == RestOffset.id:
            continue  # the tracker's place and its body's stand for some of them
        if key in study.model.values and study.model.sigma.get(key, 0.0) > 0.0:
            where = ParameterRef.parse(key).place
            if where != place or right & {effect.name for effect in study.model.added}:
                off[key] = (study.model.values[key] - value) / study.model.sigma[key]
    before = start.fits[joint].held_out_rms
    before, after, noise = (value * study.moves.scale for value in (before, after, noise))
    seconds = time.monotonic() - begun
    unit = study.moves.unit
    return MotionOutcome(case.name, joint + 1, named, rest, verdict, before, after, noise, off, seconds, unit)


def examine(task: tuple[str, TrueJoints, int, Made]) -> MotionOutcome:
    """The answer to a case by its name; its arm, the joint and the recording, as `answered` takes them."""
    name, arm, joint, made = task
    return answered(next(case for case in (*FIRST, *LATER) if case.name == name), arm, joint, made)


ARMS: Mapping[str, tuple[int, Callable[[list[TrueJoints], np.random.Generator], Sequence[Made]]]] = {
    "so101": (5, recorded),
    "lrm-rover": (6, toured),
}
"""By name: joints, and how they are recorded."""


def line(_key: str, one: MotionOutcome) -> str:
    """Progress in one line."""
    return (
        f"{one.case:20} joint{one.joint} {one.verdict:7} {one.before:.3f} -> {one.after:.3f} {one.unit} "
        f"(noise {one.noise:.3f}), 95 % intervals {one.inside[0]}/{one.inside[1]}, {one.seconds:.0f} s: "
        f"{', '.join(one.named) or 'no cause identified'} | {'; '.join(one.rest) or '-'}"
    )


def main() -> None:
    """Makes the recordings of all cases at once, answers them, and prints the answers."""
    given = asked(
        __doc__,
        seed=0,
        arm=("so101", "whose joints hide the causes", [*ARMS]),
        only=("", "first, later, or a part of a case's name"),
        skip=(0, "so many of the chosen cases, the first ones, are made and not answered"),
        json=None,
        write=(None, "only write the recording of the first chosen case, as a dataset"),
        jobs=1,
    )
    written = {case.name: when for when, cases in (("first", FIRST), ("later", LATER)) for case in cases}
    chosen = [case for case in (*FIRST, *LATER) if given.only in ("", written[case.name]) or given.only in case.name]
    if not chosen:
        refuse(NO_CASE)
    rng = np.random.default_rng(given.seed)
    if given.write and given.arm != "so101":
        refuse("--write is of an so101; python -m validation.motion.tracked writes a tracked tip")
    if given.write:
        arm, joint = arm_of(chosen[0], rng)
        write_dataset(given.write, recorded([arm], rng)[0], "v3.0")
        print(f"{chosen[0].name} in joint {joint + 1}, written to {given.write}")
        return
    count, record = ARMS[given.arm]
    arms = [arm_of(case, rng, count) for case in chosen]
    made = record([arm for arm, _ in arms], rng)
    tasks = {
        case.name: (case.name, arm, joint, recording)
        for case, (arm, joint), recording in [*zip(chosen, arms, made, strict=True)][max(given.skip, 0) :]
    }
    found = run_cases(tasks, examine, line, given.jobs)
    for name, one in found.items():
        print(f"{written[name]:6} {line(name, one)}")
    verdicts = Counter(one.verdict for one in found.values())
    held, of = (sum(one.inside[k] for one in found.values()) for k in (0, 1))
    print(f"{dict(verdicts)}; 95 % intervals that hold the truth: {held} of {of}")
    for name, offs in by_parameter([*found.values()]).items():
        print(
            f"  {name:28} {int(np.sum(np.abs(offs) <= 1.96)):3} of {len(offs):3}, farthest {np.max(np.abs(offs)):.1f}"
        )
    if given.json:
        cases = [{"written": written[name], **asdict(one), "inside": one.inside} for name, one in found.items()]
        given.json.write_text(json_text({"seed": given.seed, "cases": cases}), "utf-8")


def by_parameter(found: list[MotionOutcome]) -> dict[str, list[float]]:
    """Standard errors off, of all joints and cases, by `id.parameter`."""
    out: dict[str, list[float]] = {}
    for one in found:
        for key, off in one.off.items():
            kind, _, parameter = ParameterRef.parse(key)
            out.setdefault(f"{kind}.{parameter}", []).append(off)
    return out


if __name__ == "__main__":
    main()
