"""Faults of what measures, and of where it stands."""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array
from validation.hidden_effects.faults.measurement import BASE, NOISE_M, HealthyMeasurement, SpoiledMeasurement
from validation.synthetic.screws import rotation_matrix

FRAME = ("measurement_frame@frame", "frame_curve@frame", "depth_scale@frame")
CAMERA_M = np.array([1.5, -1.0, 0.8])


def _pushed(taken: HealthyMeasurement) -> Array:
    turn = rotation_matrix(np.radians(taken.rng.uniform(-0.3, 0.3, 3)))
    return np.asarray(taken.tcp @ np.asarray(turn).T + taken.rng.uniform(-0.003, 0.003, 3))


def moved_between(taken: HealthyMeasurement) -> SpoiledMeasurement:
    session: Array = np.repeat([1.0, 2.0], [len(taken.q) // 2, len(taken.q) - len(taken.q) // 2])
    return SpoiledMeasurement(np.where((session == 2.0)[:, None], _pushed(taken), taken.tcp), session, BASE)


def moved_meanwhile(taken: HealthyMeasurement) -> SpoiledMeasurement:
    after = np.arange(len(taken.q)) >= taken.moment()
    return SpoiledMeasurement(np.where(after[:, None], _pushed(taken), taken.tcp), None, BASE)


def moved_twice(taken: HealthyMeasurement) -> SpoiledMeasurement:
    row = np.arange(len(taken.q))[:, None]
    first, second = (np.array([0.3, 0.6]) * len(row)).astype(int)
    between = np.where(row >= first, _pushed(taken), taken.tcp)
    return SpoiledMeasurement(np.where(row >= second, _pushed(taken), between), None, BASE)


def grows(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """All lengths grow as the room warms up."""
    growth = 1.0 + 0.006 * taken.progress[:, None] ** 2
    return SpoiledMeasurement(taken.tcp * growth, right=("drift@frame", "drift_curve@frame"))


def line_of_sight(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """One reading in twelve lies too far along the line of sight, by some millimetres (a reflection)."""
    sight = taken.tcp - CAMERA_M
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    far = (taken.rng.random(len(sight)) < 1 / 12) * taken.rng.uniform(1.5, 4.0, len(sight)) * 1e-3
    return SpoiledMeasurement(taken.tcp + far[:, None] * sight)


def lens(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A lens stretches space the more the farther from the middle of what it sees."""
    apart = taken.tcp - taken.tcp.mean(axis=0)
    square = (apart**2).sum(axis=1, keepdims=True)
    strength = taken.rng.uniform(0.01, 0.02) * taken.rng.choice([-1.0, 1.0]) / square.max()
    return SpoiledMeasurement(taken.tcp + strength * square * apart, right=FRAME)


def perspective(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A camera's depth scale grows with the distance."""
    apart = taken.tcp - CAMERA_M
    far = np.linalg.norm(apart, axis=1, keepdims=True)
    part = (far - far.mean()) / np.ptp(far)
    return SpoiledMeasurement(taken.tcp + taken.rng.uniform(0.006, 0.012) * part**2 * apart, right=FRAME)


def azimuth_wave(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A tracker's turntable is off its centre: its azimuth errs by a wave."""
    apart = taken.tcp - CAMERA_M
    azimuth = np.arctan2(apart[:, 1], apart[:, 0])
    by = taken.rng.uniform(1e-3, 2e-3) * np.sin(6.0 * azimuth + taken.rng.uniform(0.0, 6.0))
    across = np.stack([-apart[:, 1], apart[:, 0], np.zeros(len(by))], axis=1)
    return SpoiledMeasurement(taken.tcp + by[:, None] * across, right=FRAME)


def sheared(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The axes of a measuring machine are not square."""
    tcp = taken.tcp.copy()
    tcp[:, 0] += taken.rng.uniform(0.004, 0.008) * taken.tcp[:, 2]
    return SpoiledMeasurement(tcp, right=FRAME)


def creeping_tripod(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A tripod settles, fast at first."""
    shift = taken.rng.uniform(0.002, 0.004, 3) * (1.0 - np.exp(-4.0 * taken.progress))[:, None]
    return SpoiledMeasurement(taken.tcp + shift, right=BASE)


def wandering(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A tracker wanders to and fro over the hours."""
    phase = taken.rng.uniform(0.0, 6.0, 3)
    wave = np.sin(2.0 * np.pi * 1.5 * taken.progress[:, None] + phase)
    return SpoiledMeasurement(taken.tcp + 0.0015 * wave, right=BASE)


def late(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """Readings were taken before the filter had settled: a part of the way from the pose before is missing."""
    before = np.vstack([taken.tcp[:1], taken.tcp[:-1]])
    return SpoiledMeasurement(taken.tcp + taken.rng.uniform(0.006, 0.012) * (before - taken.tcp))


def noisier_afar(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """Noise grows with the distance from the camera, 2.5 times at the far end."""
    far = np.linalg.norm(taken.tcp - CAMERA_M, axis=1)
    part = (far - far.min()) / np.ptp(far)
    return SpoiledMeasurement(taken.tcp + 2.3 * NOISE_M * part[:, None] * taken.rng.normal(size=taken.tcp.shape))


def another_marker(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The tracker took another marker of the gripper for the target, in one pose of fifteen."""
    turned = taken.moved(taken.q.shape[1] - 2, np.full(len(taken.q), 0.3)) - taken.tcp
    off = turned / np.linalg.norm(turned, axis=1, keepdims=True) * taken.rng.uniform(0.012, 0.02)
    mistaken = (taken.rng.random(len(taken.q)) < 1.0 / 15.0)[:, None]
    return SpoiledMeasurement(np.where(mistaken, taken.tcp + off, taken.tcp))


def base_sinks_and_is_put_right(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The base tilts more and more, and is put right at one pose."""
    since, tilt = taken.moment(), np.radians(taken.rng.uniform(0.4, 0.8))
    row = np.arange(len(taken.q))
    by = tilt * np.where(row < since, row / since, 0.0)
    x, y, z = taken.tcp.T
    tilted = np.stack([np.cos(by) * x + np.sin(by) * z, y, np.cos(by) * z - np.sin(by) * x], axis=1)
    return SpoiledMeasurement(tilted, right=(*BASE, "second_change_point@base"))


def two_cameras(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """One half of the space is seen by another camera, whose position is known a little wrongly."""
    off = taken.rng.normal(size=3)
    off *= taken.rng.uniform(0.0015, 0.0025) / np.linalg.norm(off)
    seen = np.where(taken.tcp[:, 1:2] > np.median(taken.tcp[:, 1]), taken.tcp + off, taken.tcp)
    return SpoiledMeasurement(seen, right=FRAME)
