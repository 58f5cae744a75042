"""Identity of the arm that a state file belongs to: its pulses are a pose of that arm and those servos only."""

from __future__ import annotations

import hashlib
import json

from lrmd.config import Config
from lrmd.persistence.state_file import StoredState


def arm_identity(config: Config) -> str:
    """SHA-256 of what a pulse means: name and geometry of the arm; name, channel and table of every servo."""
    joints = [(j.theta, j.d, j.a, j.alpha, j.extra_z, *((j.beta,) if j.beta else ())) for j in config.arm.joints]
    servos = [(s.name, s.channel, s.table.angle, s.table.pulse) for s in config.servos]
    return hashlib.sha256(json.dumps([config.arm.name, joints, servos]).encode()).hexdigest()


def of_this_arm(stored: StoredState, config: Config) -> tuple[StoredState, str]:
    """Part of a stored state that is true of the configured arm, and why the rest is not used; empty if all is used.

    The temperatures of an arm of the same name stay: it may be hot although its servo tables were changed.
    """
    if stored.identity == arm_identity(config):
        return stored, ""
    without_pose = stored.model_copy(update={"pulse_ns": {}, "still": True})
    name = config.arm.name
    if not stored.identity:
        return without_pose, "it does not say which arm its pose is of (an older release wrote it)"
    if stored.arm == name:
        return without_pose, f"the geometry or the servo tables of {name} were changed since its pose was stored"
    without_heat = without_pose.model_copy(update={"temperature_c": {}, "payload_kg": 0.0})
    return without_heat, f"it is the state of {stored.arm}, and this daemon drives {name}"
