"""What the unknown phase of the board's frames leaves of a prediction: the same moves at many phases of the frames.

`python -m validation.swinging_arm [--moves 100] [--pwm 50] [--kinds off zvd timed] [--clock 0.0] [--seed 3]
[--json FILE]`

The simulated rover (`lrmd.sim`: servos with a dead band, links on springs) makes every move at 12 phases at once. Of
each shaper are printed: the swing, settling, how often `settle_s` is right within 20 % (or 0.1 s), and how often the
best single number of each move is, which an oracle would choose that knows everything but the phase; and how often
the tip has settled by `settle_s` and by `settle_95_s`. Figures of the first and second half of the moves stand apart:
what was chosen by the first half is reported by the second.
"""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from functools import partial

import numpy as np

from lrm_math.arrays import Array
from lrm_math.model.model import model_of
from lrmd.control.motion_predictor import MotionPredictor
from lrmd.sim.arm import SimulatedArm
from lrmd.sim.servo import LARGE_SERVO
from lrmd.sim.swing import inertia
from validation.options import Count, asked
from validation.runner import json_text, run_cases
from validation.swinging_arm.rig import SPRINGS, SwingingRover, known_model, tip_of

PHASES, STEP, EVERY, FOLLOWED_S, INERTIA_TICKS, AT_ONCE = 12, 0.001, 4, 10.0, 8, 50
"""Phases of the frames; s of a step, and steps between two tips; s for which a tip is followed; ticks between postures
of which the inertia is taken; moves that are simulated at once."""
WITHIN = (0.0005, 0.0001)
"""m: distances from its rest within which a tip counts as settled."""


def distances_from_rest(rover: SwingingRover, paths: list[Array], frame: float) -> Array:
    """(N, PHASES, T), m, of the tips from their rest after the ends of N moves.

    `paths`: (M + 1, n) each, rad, what the board is told after each tick; `frame`: s.
    """
    N, tick, longest = len(paths), rover.tick_s, max(len(path) for path in paths) - 1
    lengths = np.array([len(path) - 1 for path in paths])
    told = np.stack([np.concatenate([np.tile(path[0], (longest + 1 - len(path), 1)), path]) for path in paths])
    soft = [i for i, name in enumerate(rover.arm.joint_names) if name in SPRINGS]
    springs = [SPRINGS[rover.arm.joint_names[i]] for i in soft]
    stiff, braked = (np.array([getattr(spring, of) for spring in springs]) for of in ("stiffness", "damping"))
    chain = rover.links.truth.chain
    led = np.array([[inertia(chain, q, 0.0)[soft] for q in path[::INERTIA_TICKS]] for path in told])  # (N, K, k, n)
    last = np.array([inertia(chain, path[-1], 0.0)[soft] for path in told])
    bands = np.array([servo.band for servo in rover.links.joints])
    phases = (np.arange(PHASES) + 0.5) / PHASES * frame
    servo = np.repeat(told[:, :1], PHASES, axis=1)  # (N, P, n)
    turning, z, speed = np.zeros_like(servo), np.zeros((N, PHASES, len(soft))), np.zeros((N, PHASES, len(soft)))
    fades, before, out = math.exp(-STEP / LARGE_SERVO.lag), math.ceil((longest * tick + frame) / STEP), []
    for k in range(before + round(FOLLOWED_S / STEP)):
        since = k * STEP - (before * STEP - lengths * tick)  # s since each move began
        if k % (every := round(INERTIA_TICKS * tick / STEP)) == 0:
            M = led[:, min(k // every, led.shape[1] - 1)] if k < before else last
            inverse = np.linalg.inv(M[:, :, soft])
            momentum = speed @ M[:, :, soft] + turning @ M.transpose(0, 2, 1)
        began = np.floor((since[:, None] - phases) / frame) * frame + phases
        at = np.clip(np.floor(began / tick + 1e-9).astype(int), 0, lengths[:, None]) + (longest - lengths)[:, None]
        left = told[np.arange(N)[:, None], at] - servo
        far = np.abs(left)
        turn = np.sign(left) * (far - np.where(far <= bands, far, np.maximum(far * fades, bands)))
        servo, turning = servo + turn, turn / STEP
        momentum = momentum - STEP * (stiff * z + braked * speed)
        speed = (momentum - turning @ M.transpose(0, 2, 1)) @ inverse
        z = z + STEP * speed
        if k >= before and (k - before) % EVERY == 0:
            links = servo.copy()
            links[..., soft] += z
            out.append(tip_of(rover.arm, links.reshape(-1, servo.shape[2])).reshape(N, PHASES, 3))
    tips = np.stack(out, axis=2)
    return np.asarray(np.linalg.norm(tips - tips[:, :, -1:], axis=3))


def settling_times(away: Array, within: float) -> Array:
    """(N, PHASES), s, after which the tip stays within a distance (m)."""
    far = away[..., ::-1] > within
    return np.where(far.any(axis=-1), (far.shape[-1] - np.argmax(far, axis=-1)) * STEP * EVERY, 0.0)


def hits_of(told: Array, true: Array) -> Array:
    """Whether times are right within 20 %, or 0.1 s."""
    return np.asarray(np.abs(told - true) <= np.maximum(0.2 * true, 0.1))


def best_hit_rate(true: Array) -> float:
    """The largest share of times (P,) for which one number is right."""
    return float(max(hits_of(told, true).mean() for told in (*true, *np.linspace(0.0, true.max(), 200))))


def examine(moves: int, clock: float, seed: int, case: tuple[float, str]) -> dict[str, object]:
    """The moves of one shaper, by the frequency of the pulses (Hz) and its kind; `clock`: relative error of the board's
    clock."""
    pwm_hz, kind = case
    rover = SwingingRover(pwm_hz, kind)
    channels = {s.name: s.channel for s in rover.config.servos if s.name in rover.arm.joint_names}
    rover.links = SimulatedArm(model_of(rover.arm, ()), channels)  # its tip is not asked for
    rng = np.random.default_rng(seed)
    legs = [rover.move(rng.uniform(-1.0, 1.0, rover.arm.dof)) for _ in range(moves)]
    paths = [rover.known._path(leg.move) for _, leg in legs]
    frame = rover.known._frame * (1.0 + clock)
    away = np.concatenate([distances_from_rest(rover, paths[k : k + AT_ONCE], frame) for k in range(0, moves, AT_ONCE)])
    swing = 1e3 * np.sqrt(np.mean(away[..., round(0.2 / STEP / EVERY) : round(2.2 / STEP / EVERY)] ** 2, axis=2))
    row: dict[str, object] = {
        "pwm_hz": pwm_hz, "shaping": kind, "clock": clock, "tick_ms": 1e3 * rover.tick_s,
        "swing_rms_mm": float(swing.mean()), "move_s": float(np.mean([seconds for seconds, _ in legs])),
    }  # fmt: skip
    for within in WITHIN:
        motion = rover.config.motion.model_copy(update={"within_mm": 1e3 * within})
        predictor = MotionPredictor(replace(rover.config, motion=motion), known_model(rover.arm))
        told, sure = np.array([predictor.settling(leg) for _, leg in legs]).T
        true = settling_times(away, within)
        usual, held = ((true <= of[:, None] + STEP * EVERY).mean(axis=1) for of in (told, sure))
        hits, best = hits_of(told[:, None], true).mean(axis=1), np.array([best_hit_rate(times) for times in true])
        row[f"within_{1e3 * within:g}_mm"] = {
            "settling_s": float(true.mean()), "settle_95_s": float(sure.mean()),
            "median_ratio": float(np.median(told[:, None] / np.maximum(true, 0.02))),
            **{
                f"{name}_{half}": float(value[rows].mean())
                for name, value in (
                    ("right", hits), ("permitted", best), ("settled_by_usual", usual), ("settled_by_95", held),
                )
                for half, rows in (("first", slice(0, moves // 2)), ("second", slice(moves // 2, None)))
            },
        }  # fmt: skip
    return row


def main() -> None:
    """Prints a row for each shaper."""
    given = asked(
        __doc__,
        moves=Count(100),
        pwm=([50.0], "Hz, of the pulses"),
        kinds=(["off", "zvd", "timed"], "of shaping"),
        clock=(0.0, "relative error of the board's oscillator_hz"),
        seed=(3, "of the moves"),
        json=None,
        jobs=1,
    )
    cases = {f"{pwm:g} Hz, {kind}": (pwm, kind) for pwm, kind in itertools.product(given.pwm, given.kinds)}
    found = run_cases(cases, partial(examine, given.moves, given.clock, given.seed), _line, given.jobs)
    for row in found.values():
        print(json.dumps(row))
    if given.json:
        given.json.write_text(json_text([*found.values()]), "utf-8")


def _line(key: str, row: dict[str, object]) -> str:
    return f"{key}: {row['swing_rms_mm']:.3f} mm RMS of swing"


if __name__ == "__main__":
    main()
