"""Faults of joints that are loose, slip or change while they are measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from validation.hidden_effects.faults.measurement import HealthyMeasurement, SpoiledMeasurement, at_joint


def _slips(taken: HealthyMeasurement, joint: int, degrees: float) -> SpoiledMeasurement:
    q, name = taken.q.copy(), f"change_point@joint{joint + 1}"
    q[taken.moment() :, joint] += np.radians(degrees)
    return SpoiledMeasurement(taken.at(q), None, (name,))


def skipped_tooth(taken: HealthyMeasurement) -> SpoiledMeasurement:
    return _slips(taken, taken.joint(), taken.rng.uniform(0.6, 1.5))


def reflector_slipped(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The reflector turns about the last axis, as if the last joint stood elsewhere."""
    slipped = _slips(taken, taken.q.shape[1] - 1, taken.rng.uniform(3.0, 6.0))
    return replace(slipped, right=(*slipped.right, "change_point@tool"))


def loose(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A screw that lets a joint rest at either of two angles, whatever the pose."""
    q, size = taken.q.copy(), np.radians(taken.rng.uniform(0.4, 0.9))
    q[:, taken.joint()] += size * taken.rng.choice([-0.5, 0.5], len(q))
    return SpoiledMeasurement(taken.at(q))


def loosens(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The same, but the screw comes loose in the middle."""
    q, size = taken.q.copy(), np.radians(taken.rng.uniform(0.6, 1.2))
    since = taken.moment()
    q[since:, taken.joint()] += size * taken.rng.choice([-0.5, 0.5], len(q) - since)
    return SpoiledMeasurement(taken.at(q))


def play_grows(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """Play that wears in: nothing at first, up to a degree in the end, with the torque's side."""
    joint = taken.joint()
    side = np.tanh(20.0 * np.cos(taken.q[:, 1 : joint + 1].sum(axis=1)))
    by = np.radians(taken.rng.uniform(0.6, 1.2)) * taken.progress * side
    return SpoiledMeasurement(taken.moved(joint, by), right=at_joint(joint, "backlash"))


def warms_when_loaded(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A servo drifts with the work that it has done."""
    work, joint = np.cumsum(taken.weight_moment**2), taken.joint()
    by = np.radians(taken.rng.uniform(0.8, 1.5)) * (work / work[-1]) * taken.weight_moment
    return SpoiledMeasurement(taken.moved(joint, by), right=at_joint(joint, "drift", "drift_curve"))


def sticks(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A dry bearing stops short by some part of a degree, each time by another."""
    by = np.radians(taken.rng.uniform(0.4, 0.8)) * taken.rng.uniform(-1.0, 1.0, len(taken.q))
    return SpoiledMeasurement(taken.moved(taken.joint(), by))


def creeps(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """Plastic remembers the load of the poses before."""
    size, decay, memory = np.radians(taken.rng.uniform(0.8, 1.4)), 0.7, np.zeros(len(taken.q))
    for row in range(1, len(memory)):
        memory[row] = decay * memory[row - 1] + (1.0 - decay) * taken.weight_moment[row - 1]
    return SpoiledMeasurement(taken.moved(taken.joint(), size * (memory - memory.mean()) / np.ptp(memory)))


def cable_winds(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """A cable catches now and then: a joint stands off by steps that add up and let go."""
    steps = (taken.rng.random(len(taken.q)) < 0.06) * taken.rng.normal(size=len(taken.q))
    joint = taken.joint()
    named = at_joint(joint, "change_point", "second_change_point", "drift", "drift_curve")
    return SpoiledMeasurement(taken.moved(joint, np.radians(0.4) * np.cumsum(steps)), right=named)


def tool_slips_under_load(taken: HealthyMeasurement) -> SpoiledMeasurement:
    """The gripper gives way when it carries something, and stays there."""
    loaded = np.cumsum(taken.load > 0.0) > len(taken.load) // 5
    by = np.radians(taken.rng.uniform(1.5, 3.0)) * loaded
    joint = taken.q.shape[1] - 2
    return SpoiledMeasurement(taken.moved(joint, by), right=at_joint(joint, "change_point"))


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
