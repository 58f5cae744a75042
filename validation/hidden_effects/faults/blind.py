"""Faults that were written down, with what is right for them, after all judgement was set, and run once."""

from __future__ import annotations

import numpy as np

from lrm_math.arm.place_names import both, turned_by
from lrm_math.effects.reference import EffectRef
from validation.hidden_effects.faults.measurement import BASE, HealthyMeasurement, SpoiledMeasurement, at_joint


def wears_where_it_works(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """Play in the worn part of a gear, and none where it hardly ever stands."""
    joint = taken.joint()
    side = np.tanh(20.0 * np.cos(taken.q[:, 1 : joint + 1].sum(axis=1)))
    worn = np.exp(-((taken.q[:, joint] / np.radians(35.0)) ** 2))
    by = np.radians(taken.rng.uniform(1.0, 1.8)) * side * worn
    return SpoiledMeasurement(taken.moved(joint, by), right=at_joint(joint, "backlash"))


def gives_way_beyond_a_torque(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A servo holds up to a torque, and sags beyond it."""
    joint = taken.joint()
    torque = np.cos(taken.q[:, 1 : joint + 1].sum(axis=1)) * taken.weight_moment
    beyond = np.sign(torque) * np.maximum(np.abs(torque) - 0.4 * np.abs(torque).max(), 0.0)
    by = np.radians(taken.rng.uniform(1.5, 2.5)) * beyond / np.abs(beyond).max()
    named = ("nonlinear_stiffness", "torque_curve", "compliance", "backlash")
    return SpoiledMeasurement(taken.moved(joint, by), right=at_joint(joint, *named))


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


def rows_sorted_afterwards(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A joint drifted, and somebody sorted the rows by the first joint: their order tells nothing any more."""
    joint, order = taken.joint(), np.argsort(taken.q[:, 0])
    tcp = taken.moved(joint, np.radians(taken.rng.uniform(0.8, 1.4)) * (taken.progress - 0.5))
    return SpoiledMeasurement(tcp[order], q=taken.q[order], load=taken.load[order])


def two_cameras(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """One half of the space is seen by another camera, whose position is known a little wrongly."""
    off = taken.rng.normal(size=3)
    off *= taken.rng.uniform(0.0015, 0.0025) / np.linalg.norm(off)
    seen = np.where(taken.tcp[:, 1:2] > np.median(taken.tcp[:, 1]), taken.tcp + off, taken.tcp)
    return SpoiledMeasurement(seen, right=("frame_curve@frame", "measurement_frame@frame", "depth_scale@frame"))


def stands_off_beyond_zero(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A servo's horn stands off by a step where its pulse is longer than in the middle."""
    joint = taken.joint()
    by = np.radians(taken.rng.uniform(0.5, 0.9)) * (taken.q[:, joint] > 0.0)
    named = ("servo_gain", "eccentricity", "cable_spring", "angle_curve")
    return SpoiledMeasurement(taken.moved(joint, by), right=at_joint(joint, *named))


def overshoots_by_the_way(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A servo goes too far by a part of its last motion."""
    joint = taken.joint()
    by = taken.rng.uniform(0.008, 0.015) * np.diff(taken.q[:, joint], prepend=0.0)
    named = ("hysteresis", "friction_curve")
    return SpoiledMeasurement(taken.moved(joint, by), right=at_joint(joint, *named))


def servo_replaced(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """From one pose on another servo turns a joint, with another zero and another gain."""
    joint, since = taken.joint(), np.arange(len(taken.q)) >= taken.moment()
    off, gain = np.radians(taken.rng.uniform(0.5, 1.0)), taken.rng.uniform(0.008, 0.015)
    by = since * (off + gain * taken.q[:, joint])
    return SpoiledMeasurement(taken.moved(joint, by), right=at_joint(joint, "change_point"))


def somebody_walks_by(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The table shakes while one pose in ten is measured."""
    shaken = (taken.rng.random(len(taken.q)) < 0.1)[:, None]
    return SpoiledMeasurement(taken.tcp + shaken * taken.rng.normal(scale=0.002, size=taken.tcp.shape))


def load_written_wrongly(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The load was put on a scale that shows twice as much."""
    return SpoiledMeasurement(taken.tcp, load=2.0 * taken.load, right=("payload@tool",))


def follows_a_square(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A hose bends with the joint before and pulls on the next one, both ways alike."""
    joint = taken.joint()
    before = taken.q[:, joint - 1]
    by = np.radians(taken.rng.uniform(0.8, 1.4)) * (before / np.abs(before).max()) ** 2
    one, other = f"joint{joint}", f"joint{joint + 1}"
    place = turned_by(other, one)
    right = EffectRef("coupling", place), EffectRef("coupling_curve", place), EffectRef("cable_curve", both(one, other))
    return SpoiledMeasurement(taken.moved(joint, by), right=tuple(map(str, right)))
