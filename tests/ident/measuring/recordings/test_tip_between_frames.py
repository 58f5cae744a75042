"""A tip between two frames of a tracker: where it was, and how far the noise of the frames shows there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lrm_ident.measuring.recordings.take import TipTrack
from lrm_math.arrays import Array

FRAME_S = 1.0 / 77.0


def frames(count: int) -> Array:
    """Times, s."""
    return np.asarray(FRAME_S * np.arange(count), dtype=np.float64)


def track(t: Array, x: Array) -> TipTrack:
    return TipTrack(Path("tip.csv"), t, np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1))


def test_a_quick_swing_keeps_its_size_between_frames() -> None:
    """Of 6 Hz, straight lines would take 3 % away."""
    t, omega = frames(400), 2.0 * np.pi * 6.0
    between = np.asarray(t[50:-50] + 0.5 * FRAME_S, dtype=np.float64)
    seen = track(t, np.sin(omega * t)).at(between)[:, 0]
    assert np.abs(seen - np.sin(omega * between)).max() < 2e-3


def test_a_gap_leaves_the_tip_beside_it_as_it_was() -> None:
    t = frames(600)
    kept = (t < 3.0) | (t > 5.0)
    x = 0.1 * np.sin(2.0 * np.pi * t)
    beside = t[(t < 3.0 - 6 * FRAME_S) & (t > 0.1)] + 0.5 * FRAME_S
    assert np.abs(track(t[kept], x[kept]).at(beside)[:, 0] - 0.1 * np.sin(2.0 * np.pi * beside)).max() < 1e-5


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5])
def test_noise_between_frames_is_what_the_spline_leaves_of_it(share: float) -> None:
    rng, t = np.random.default_rng(0), frames(20_000)
    noisy = track(t, rng.normal(size=len(t)))
    at = np.asarray(t[50:-50] + share * FRAME_S, dtype=np.float64)
    left = float(noisy.at(at)[:, 0].std())
    scatter = TipTrack(Path("tip.csv"), t, rng.normal(size=(len(t), 3)))
    assert scatter.noise_at(at) / scatter.noise == pytest.approx(left, rel=0.02)
