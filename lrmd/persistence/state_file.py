"""The state file, which survives crashes and power cuts: written atomically (temporary file, fsync, rename).

It is saved on change, at least once a minute, and during a motion only at an interval, in a thread of its own, so that
a slow disk does not block the daemon.

Its pose is taken back, by a rename, before the arm may leave it. So where the disk has become read-only the pose that
stays there is the arm's, as no motion begins. Where the file cannot be saved, for instance because the disk is full, it
is renamed, too, which takes no room: its pose is not that of the arm any more.

At a start it is set aside, with an event, if it is damaged or of another arm: its pulses are a pose of the arm and the
servos that it was written for, and of no others.
"""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import astuple
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from lrm_math.atomic_file import write_atomically
from lrm_math.errors import FileError
from lrm_math.toml_file import StrictSchema
from lrmd.config import Config, LinkTable

HOTTEST = 300.0
"""degC: higher modelled temperatures are stored as this one."""
NAME, OUTDATED = "state.json", "state.outdated.json"
Emit = Callable[[str, Literal["error"], str], object]
"""Called with an event's code, level and text."""


Centre = Annotated[list[Annotated[float, Field(ge=-0.2, le=0.2)]], Field(min_length=3, max_length=3)]


class StoredArrival(StrictSchema):
    """How a joint came to where it is: sign of its last move, and states (−1 … 1) of its friction; 0: unknown."""

    direction: Annotated[int, Field(ge=-1, le=1)] = 0
    friction: Annotated[list[Annotated[float, Field(ge=-1, le=1)]], Field(min_length=3, max_length=3)] = [0.0] * 3


class StoredState(StrictSchema):
    """The state file, schema `lrm/state/1`: last commanded pulse (ns) and modelled temperature of each servo.

    `still`: no motion was under way when it was written, so the pulses are the arm's final position. `arm`, `identity`:
    name and `arm_identity` of the arm that they are of, empty in files of older releases. `payload_kg`,
    `payload_centre_m`: its load, as in `PayloadRequest`.
    `fallen`: servos that are not at their pulse any more, or would not be without pulses; None in files of older
    releases: all may be.
    `arrival`: of joints whose last move is known. `powered_s`: time for which the joints have had pulses, 0 without,
    and `powered_at_c`, degC, of the hottest servo at its beginning.
    """

    schema_: Literal["lrm/state/1"] = Field(default="lrm/state/1", alias="schema")
    saved_wall_ns: int
    boots: Annotated[int, Field(ge=0)]
    arm: str = ""
    identity: str = ""
    mode: str
    still: bool
    pulse_ns: dict[str, Annotated[int, Field(ge=0, le=20_000_000)]]
    payload_kg: Annotated[float, Field(ge=0, le=2)] = 0.0
    payload_centre_m: Centre = [0.0] * 3
    temperature_c: dict[str, Annotated[float, Field(ge=-50, le=HOTTEST)]]
    fallen: list[str] | None = None
    arrival: dict[str, StoredArrival] = {}
    powered_s: Annotated[float, Field(ge=0)] = 0.0
    powered_at_c: float = 0.0


def save(folder: Path, state: StoredState) -> None:
    """Writes the state atomically: a power cut leaves the old or the new file. Raises `FileError`."""
    write_atomically(folder / NAME, state.model_dump_json(by_alias=True, indent=1).encode())


def load(folder: Path) -> StoredState | None:
    """The stored state, an outdated one without its pose, or None. Raises `FileError` if the file is damaged."""
    state = _read(folder / NAME)
    if state is None and (old := _read(folder / OUTDATED)) is not None:
        return old.model_copy(update={"still": False, "fallen": None})
    return state


def outdate(folder: Path) -> None:
    """Renames the file, whose pose is not that of the arm any more. Raises `OSError`."""
    with suppress(FileNotFoundError):
        os.replace(folder / NAME, folder / OUTDATED)


def _read(path: Path) -> StoredState | None:
    try:
        return StoredState.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        raise FileError(path, "", f"cannot be read ({error.strerror})") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise FileError(path, ".".join(map(str, first["loc"])), f"is damaged ({first['msg']})") from None


def set_aside(folder: Path, suffix: str = ".damaged") -> Path:
    """Renames a file that cannot be used, for inspection. Returns its new path."""
    path = folder / NAME
    aside = path.with_suffix(suffix)
    os.replace(path, aside)
    return aside


def arm_identity(config: Config) -> str:
    """SHA-256 of what a pulse means: name and geometry of the arm; name, channel and table of every servo; the clock,
    if it is not the nominal one."""
    joints = [(j.theta, j.d, j.a, j.alpha, j.extra_z, *((j.beta,) if j.beta else ())) for j in config.arm.joints]
    servos = [(s.name, s.channel, s.table.angle, s.table.pulse) for s in config.servos]
    nominal = LinkTable.model_fields["oscillator_hz"].default
    clock = [config.link.oscillator_hz] if config.link.oscillator_hz != nominal else []
    followed = [astuple(mimic) for mimic in config.arm.mimics]
    return hashlib.sha256(json.dumps([config.arm.name, joints, servos, *clock, *followed]).encode()).hexdigest()


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
        return without_pose, f"the geometry, clock or servo tables of {name} were changed since its pose was stored"
    empty: dict[str, object] = {"payload_kg": 0.0, "payload_centre_m": [0.0] * 3}
    without_heat = without_pose.model_copy(update={"temperature_c": {}, **empty})
    return without_heat, f"it is the state of {stored.arm}, and this daemon drives {name}"


def restored_state(config: Config, emit: Emit) -> StoredState | None:
    """The state that the daemon left, or None if there is none that can be used."""
    folder = config.state
    try:
        folder.mkdir(mode=0o750, parents=True, exist_ok=True)
        stored = load(folder)
    except FileError as error:
        emit("state_damaged", "error", f"{error}; it is set aside, and the pose is unknown")
        _try_to_set_aside(folder, ".damaged", emit)
        return None
    except OSError as error:
        emit("state_not_saved", "error", f"{folder}: {error.strerror}")
        return None
    if stored is None:
        return None
    stored, why_not = of_this_arm(stored, config)
    if why_not:
        where = folder / NAME
        emit("state_foreign", "error", f"{where}: {why_not}; it is set aside, and the pose is unknown")
        _try_to_set_aside(folder, ".foreign", emit)
    return stored


def _try_to_set_aside(folder: Path, suffix: str, emit: Emit) -> None:
    try:
        set_aside(folder, suffix)
    except OSError as fault:
        emit("state_not_saved", "error", f"it cannot be set aside either ({fault.strerror})")


INTERVAL = 60_000_000_000
"""ns after which it is saved without a change too."""


class SaveSchedule:
    """`moving_interval`: ns between two states that are saved during a motion."""

    def __init__(self, moving_interval: int) -> None:
        self._moving_interval = moving_interval
        self._at = 0
        self._state: tuple[object, ...] = ()
        self._moving = False

    def again(self) -> None:
        """The next state is to be saved, whatever it is."""
        self._state = ()

    def due(self, state: tuple[object, ...], moving: bool, now: int) -> bool:
        """Whether to save at `now` (ns); if so, it is the saved state from now on."""
        wait = self._moving_interval if moving and self._moving else 0
        changed = state != self._state and now - self._at >= wait
        if not changed and now - self._at <= INTERVAL:
            return False
        self._at, self._state, self._moving = now, state, moving
        return True


class BackgroundWriter:
    """`on_change` is called with the error when writing fails, and with None when it works again."""

    def __init__(self, folder: Path, on_change: Callable[[FileError | None], None]) -> None:
        self._folder, self._on_change = folder, on_change
        self._wake = threading.Condition()
        self._next: StoredState | None = None
        self._ending = False
        self._broken = False
        self._has_pose = (folder / NAME).exists()
        self._thread = threading.Thread(target=self._run, name="writer", daemon=True)
        self._thread.start()

    def put(self, state: StoredState) -> None:
        """Queues a state; it replaces one that is not written yet."""
        with self._wake:
            self._next = state
            self._wake.notify()

    def leave_pose(self) -> bool:
        """Takes the stored pose back, as the arm is about to leave it; False: it was not one that could be armed at.

        Waits for the disk. Raises `FileError`: it cannot be taken back, and would be taken for the arm's after a fall.
        """
        if not self._has_pose:
            return False
        try:
            outdate(self._folder)
        except OSError as error:
            raise FileError(self._folder / NAME, "", f"cannot be renamed ({error.strerror})") from None
        self._has_pose = False
        return True

    def close(self) -> None:
        """Waits until the queued state is saved."""
        with self._wake:
            self._ending = True
            self._wake.notify()
        self._thread.join(5.0)

    def _run(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._next is not None or self._ending)
                state, self._next = self._next, None
            if state is None:
                return
            self._save(state)

    def _save(self, state: StoredState) -> None:
        failure = None
        with suppress(OSError):
            try:
                self._has_pose |= state.still  # from the rename on, which is before the end of `save`
                save(self._folder, state)
                self._has_pose = state.still
                (self._folder / OUTDATED).unlink(missing_ok=True)
            except FileError as error:
                failure = error
                outdate(self._folder)
                self._has_pose = False
        if self._broken is (failure is None):
            self._on_change(failure)
        self._broken = failure is not None
