"""The stored state at a start: set aside, with an event, if it is damaged or of another arm.

Its pulses are a pose of the arm and the servos that it was written for, and of no others.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from lrm_math.errors import FileError
from lrmd.config import Config
from lrmd.persistence import state_file
from lrmd.persistence.state_file import StoredState

Emit = Callable[[str, Literal["error"], str], object]
"""Called with an event's code, level and text."""


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


def restored_state(config: Config, emit: Emit) -> state_file.StoredState | None:
    """The state that the daemon left, or None if there is none that can be used."""
    folder = config.state
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stored = state_file.load(folder)
    except FileError as error:
        emit("state_damaged", "error", f"{error}; it is set aside, and the pose is unknown")
        _set_aside(folder, ".damaged", emit)
        return None
    except OSError as error:
        emit("state_not_saved", "error", f"{folder}: {error.strerror}")
        return None
    if stored is None:
        return None
    stored, why_not = of_this_arm(stored, config)
    if why_not:
        where = folder / state_file.NAME
        emit("state_foreign", "error", f"{where}: {why_not}; it is set aside, and the pose is unknown")
        _set_aside(folder, ".foreign", emit)
    return stored


def _set_aside(folder: Path, suffix: str, emit: Emit) -> None:
    try:
        state_file.set_aside(folder, suffix)
    except OSError as fault:
        emit("state_not_saved", "error", f"it cannot be set aside either ({fault.strerror})")
