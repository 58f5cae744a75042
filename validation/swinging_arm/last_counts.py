"""`python -m validation.swinging_arm.last_counts [--seed 3]`: at 50 Hz, other times for the last counts.

A shaped move goes in counts of the board, from frame to frame. Here the last counts of every joint are put out some
frames later, so that the jolts of all of them cancel in the modes that the model knows (coordinate descent on the grid
of frames). No count is ahead of the ramp, and two of one joint are as far apart as the law of 1 µs in 6.5 ms demands.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from lrm_math.arrays import Array
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.motion.modes import modes_at
from validation.options import asked
from validation.swinging_arm.limits import REST, Bench

LAG_S, FINE, SECONDS = 0.03, 10, 3.6
"""s, of the servos; steps to a frame, and s, of a count's response."""
LAST_S, MOST_LATER, TURNS = 1.2, 12, 6
"""s before the end from which counts may wait; frames that one may wait; rounds of the descent."""
LAW = 6.5e3
"""s of a ramp for a second of pulse: 1 µs in 6.5 ms."""


def staircase(bench: Bench, ramp: Array) -> Array:
    """(F, n), counts of the board in each frame of a ramp (M, n), ns."""
    count = bench.config.clock.count_s * 1e9
    frames = np.arange(int(np.ceil(len(ramp) * bench.tick / bench.frame)) + 1)
    at = np.minimum((frames * bench.frame / bench.tick).astype(int), len(ramp) - 1)
    return np.asarray(np.floor(ramp[at] / count + 0.5)).astype(np.int64)


def responses(bench: Bench, goal: Array) -> Array:
    """(n, 3, F), m: of the tip, frame by frame after a count of each joint, less its new rest."""
    modes = modes_at(bench.known, goal)
    assert modes is not None
    n, h = bench.arm.dof, bench.frame / FINE
    rows = round(SECONDS / h)
    count = bench.config.clock.count_s
    middle = bench.pulses(goal) * 1e-9
    turns = np.array(
        [
            float(s.table.angle_of(p + count)) - float(s.table.angle_of(p))
            for s, p in zip(bench.servos, middle, strict=True)
        ]
    )
    chain = chain_of(bench.arm)
    geometry = chain_geometry(chain, chain.values([np.array([angle]) for angle in goal.tolist()]), 1)
    slots = list(chain.joint_slots)
    jacobian = np.cross(geometry.axis[slots, :, 0], geometry.tcp[:, 0] - geometry.origin[slots, :, 0])
    out = []
    for joint in range(n):
        servo = np.zeros((rows + 1, n))
        servo[:, joint] = turns[joint] * (1.0 - np.exp(-np.arange(rows + 1) * h / LAG_S))
        away = servo + modes.deflections(servo, h) - servo[-1]
        out.append((away @ jacobian)[::FINE].T)
    return np.array(out)


def later(bench: Bench, counts: Array, goal: Array) -> Array:
    """(F', n), the staircase with other times of its last counts."""
    answer, gap = responses(bench, goal), int(np.ceil(bench.config.clock.count_s * LAW / bench.frame))
    begin, F = max(1, len(counts) - round(LAST_S / bench.frame)), len(counts) + MOST_LATER
    window = range(F + round(0.2 / bench.frame), F + round(2.0 / bench.frame))
    jolts: list[list[list[int]]] = []
    for joint in range(counts.shape[1]):
        steps = np.diff(counts[:, joint])
        jolts.append([[k + 1, int(np.sign(steps[k]))] for k in range(len(steps)) for _ in range(abs(int(steps[k])))])

    def part(joint: int, frame: int, sign: int) -> Array:
        lags = np.array(window) - frame
        inside = np.minimum(lags, answer.shape[2] - 1)
        return np.asarray(sign * answer[joint][:, inside] * (lags < answer.shape[2]))

    total = sum(part(j, frame, sign) for j, row in enumerate(jolts) for frame, sign in row)
    first = [[frame for frame, _ in row] for row in jolts]
    for _ in range(TURNS):
        moved = False
        for joint, row in enumerate(jolts):
            for number in range(len(row) - 1, -1, -1):
                own, sign = row[number]
                earliest = first[joint][number]
                if earliest < begin:
                    break
                low = earliest if not number else max(earliest, row[number - 1][0] + _apart(first[joint], number, gap))
                high = earliest + MOST_LATER
                if number + 1 < len(row):
                    high = min(high, row[number + 1][0] - _apart(first[joint], number + 1, gap))
                without = total - part(joint, own, sign)
                choices = list(range(low, high + 1)) or [own]
                worth = [float(np.sum((without + part(joint, frame, sign)) ** 2)) for frame in choices]
                best = choices[int(np.argmin(worth))]
                if best != own and min(worth) < float(np.sum(total**2)):
                    row[number][0], moved, total = best, True, without + part(joint, best, sign)
        if not moved:
            break
    out = np.tile(counts[0], (F, 1))
    for joint, row in enumerate(jolts):
        for frame, sign in row:
            out[frame:, joint] += sign
    return out


def _apart(first: list[int], number: int, gap: int) -> int:
    """Frames between two counts of a joint at least: by the law, or as near as the ramp itself has them."""
    return min(gap, first[number] - first[number - 1])


def swing(bench: Bench, start: Array, counts: Array) -> float:
    """mm RMS after a staircase."""
    angles = bench.angles(counts * bench.config.clock.count_s * 1e9)
    seconds = len(counts) * bench.frame
    away = bench.swing(start, lambda t: np.asarray(angles[min(int(t / bench.frame + 1e-9), len(angles) - 1)]), seconds)
    return float(np.sqrt(np.mean(away[REST] ** 2)))


def main() -> None:
    """Prints the swing of each move, and of all."""
    given = asked(__doc__, moves=6, seed=3, pwm=50.0, off=0.0, band_us=0.0)
    bench, rng = Bench(given.pwm, given.off, 1e-6 * given.band_us), np.random.default_rng(given.seed)
    poses = [rng.uniform(-1.0, 1.0, bench.arm.dof) for _ in range(given.moves + 1)]
    rows = []
    for a, b in pairwise(poses):
        plain = staircase(bench, bench.ramp(a, b, ()))
        shaped = staircase(bench, bench.ramp(a, b, bench.impulses(b, "zv", bench.tick)))
        timed = later(bench, shaped, b)
        rows.append([swing(bench, a, counts) for counts in (plain, shaped, timed, later(bench, plain, b))])
        words = ("off", "zv", "zv, last counts timed", "off, last counts timed")
        print(", ".join(f"{name} {value:.3f}" for name, value in zip(words, rows[-1], strict=True)), flush=True)
    print("mean mm RMS: " + ", ".join(f"{value:.3f}" for value in np.mean(rows, axis=0)))


if __name__ == "__main__":
    main()
