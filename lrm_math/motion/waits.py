"""Waits near the end of a move that make the jolts of a coarse board's counts cancel (coordinate descent).

A board rounds pulses to counts and puts them out frame by frame, so its servos turn in jolts that no input shaper
answers. With δ_e the turn of the joints (n,) at jolt e, and g_k = driven_k δ_e, mode k swings after the end T as

    r_k = Σ_e g_ke exp(λ_k (T − t_e)),   λ = −ζω + iω√(1 − ζ²)

which is the residual of an input shaper (Singer & Seering 1990, eq. 4) with jolts in place of impulses. A move that
stands still for some ticks stays on its way and under its step; the times t_e of all later jolts change. The search
chooses these waits for the last jolts: each in turn, alone or with all that follow, takes the time that leaves the tip
the least swing. It starts several times. The phase of the frames is not known, and frequencies only nearly, so the
swing that counts is the mean over several of both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.motion.modes import modes_at
from lrm_math.motion.motion_model import MotionModel
from lrm_math.motion.settling import tip_jacobian

Waits: TypeAlias = tuple[tuple[int, int], ...]
"""Ticks of the move that remain where it waits, and the ticks for which it does."""
LAST_S, REST_S, SOON_S = 1.2, 2.0, 0.2
"""s before the end from which jolts may wait; s in which the swing counts, and after the end when that begins."""
LONGER, LEAST, MOST = 6, 40, 80
"""A move waits for a share 1/6 of its ticks, within 40 and 80 ticks."""
PHASES, FREQUENCY_FACTORS = 6, (0.96, 1.0, 1.04)
"""Phases of the frames; factors of the frequencies."""
STARTS, PASSES = 3, 6


def waits_of(model: MotionModel, path: Array, tick: float, frame: float, payload: float = 0.0) -> Waits:
    """The waits of a move along angles `path` (M + 1, n), rad, that the board puts out after each tick (s).

    `frame`: s between two pulses; `payload`: kg. Empty where nothing swings or moves.
    """
    modes = modes_at(model, path[-1], payload)
    turns = np.diff(path, axis=0)
    at = np.flatnonzero(turns.any(axis=1)) + 1
    if modes is None or not len(at):
        return ()
    length = len(path) - 1
    most = int(np.clip(length // LONGER, LEAST, MOST))
    fading = modes.damping * modes.omega
    reach = np.linalg.norm(modes.shape.T @ tip_jacobian(model, path[-1]), axis=1)
    weight = reach / np.sqrt(2.0 * fading + 1.0 / REST_S)
    poles = -fading + 2j * np.pi * modes.frequency
    seconds = np.arange(-most, length + 2 * most + 1) * tick
    phase = (np.arange(PHASES) + 0.5)[:, None] / PHASES * frame
    shown = np.ceil((seconds - phase) / frame) * frame + phase
    end = (length + most) * tick + SOON_S
    later = np.concatenate([np.exp(factor * poles[:, None, None] * (end - shown)) for factor in FREQUENCY_FACTORS])
    later = later.reshape(-1, len(seconds)).astype(np.complex64)
    swung = (weight[:, None] * (modes.driven @ turns[at - 1].T)).astype(np.float32)
    jolts = np.repeat(np.tile(swung, (len(FREQUENCY_FACTORS), 1)), PHASES, axis=0)
    free = at > length - LAST_S / tick
    fixed = np.sum(jolts[:, ~free] * later[:, most + at[~free]], axis=1)
    waited = _Search(jolts[:, free].T, most + at[free], later, fixed, most).best()
    each = zip(at[free].tolist(), np.diff(waited, prepend=0).tolist(), strict=True)
    return tuple((length - k + 1, ticks) for k, ticks in each if ticks)


@dataclass(frozen=True, eq=False)
class _Search:
    """Jolts (U, r), their swing in each of r cases; `later` (r, T): that of a unit jolt at a tick, `at` (U,) of them.

    `fixed` (r,): of the jolts before. What is searched is `waited` (U,), never falling, 0 to `most`: the ticks by which
    each jolt is late.
    """

    jolts: NDArray[np.float32]
    at: NDArray[np.int64]
    later: NDArray[np.complex64]
    fixed: NDArray[np.complex64]
    most: int

    def best(self) -> NDArray[np.int64]:
        """The best that any start leads to."""
        rng, count = np.random.default_rng(0), len(self.at)
        starts = [np.zeros(count, dtype=np.int64)]
        for _ in range(STARTS - 1):
            each = np.bincount(rng.integers(0, count, rng.integers(0, self.most + 1)), minlength=count)
            starts.append(np.cumsum(each))
        return min((self._descend(start) for start in starts), key=self._left)

    def _each(self, waited: NDArray[np.int64]) -> NDArray[np.complex64]:
        """(U, r), what each jolt leaves."""
        return np.asarray(self.jolts * self.later[:, self.at + waited].T)

    def _left(self, waited: NDArray[np.int64]) -> float:
        return float(np.sum(np.abs(self.fixed + self._each(waited).sum(axis=0)) ** 2))

    def _descend(self, waited: NDArray[np.int64]) -> NDArray[np.int64]:
        residual = self._left(waited)
        for _ in range(PASSES):
            waited = self._shift_alone(self._shift_following(waited))
            before, residual = residual, self._left(waited)
            if residual > 0.99 * before:
                break
        return waited

    def _shift_following(self, waited: NDArray[np.int64]) -> NDArray[np.int64]:
        """Each jolt, from the last, with all that follow it, at its best time after the one before it."""
        out, most = waited.copy(), self.most
        each = self._each(out)
        before = self.fixed + np.cumsum(each, axis=0) - each
        rest = np.zeros((len(self.fixed), 2 * most + 1), dtype=np.complex64)  # by a shift of -most to most
        for i in range(len(out) - 1, -1, -1):
            begin = self.at[i] + out[i] - most
            rest += self.jolts[i][:, None] * self.later[:, begin : begin + 2 * most + 1]
            low, high = (out[i - 1] if i else 0) - out[i], most - out[-1]
            choices = before[i][:, None] + rest[:, most + low : most + high + 1]
            shift = low + int(np.argmin(np.sum(choices.real**2 + choices.imag**2, axis=0)))
            if shift:
                out[i:] += shift
                rest = np.roll(rest, -shift, axis=1)
        return out

    def _shift_alone(self, waited: NDArray[np.int64]) -> NDArray[np.int64]:
        """Each jolt alone at its best time between its neighbours'."""
        out, total = waited.copy(), self.fixed + self._each(waited).sum(axis=0)
        for i, (at, jolt) in enumerate(zip(self.at, self.jolts, strict=True)):
            low, high = out[i - 1] if i else 0, out[i + 1] if i + 1 < len(out) else self.most
            if low == high:
                continue
            total = total - jolt * self.later[:, at + out[i]]
            choices = total[:, None] + jolt[:, None] * self.later[:, at + low : at + high + 1]
            out[i] = low + int(np.argmin(np.sum(choices.real**2 + choices.imag**2, axis=0)))
            total = total + jolt * self.later[:, at + out[i]]
        return out
