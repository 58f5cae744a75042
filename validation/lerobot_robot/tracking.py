"""The plug-in's lead over a bus's bytes: `python -m validation.lerobot_robot.tracking [--dead-time S] [--pty SPEED]`.

The simulated SO-101, whose servos act on a goal after a dead time, follows a teleoperator's path: by the requests
themselves, and led by the dead time. Frame by frame the encoders are read and the goals written, in the packets of the
bus. Its time is simulated; with `--pty` it is a process of its own at a device, its clock at a speed of the real one
(1: real time), on which a busy computer shows. Needs no LeRobot.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import FeetechServo
from examples.so101.launch import simulated_so101
from lerobot_robot_lrm.corrected_arm import CorrectedArm
from lerobot_robot_lrm.correction import Correction
from lrm_ident.measuring.servo_bus.bus import ServoHost
from lrm_ident.measuring.servo_bus.feetech import FEETECH
from lrm_ident.measuring.servo_bus.servos import BusServos, connected_bus, held_servos
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.model.model import model_of
from validation.lerobot_dataset import encoder_readings
from validation.lerobot_robot.in_motion import motion_model_with
from validation.options import Count, asked
from validation.tables import markdown_table

ARM = load_arm("so101")
SECONDS, SETTLES_S, FINE_S = 24.0, 2.0, 0.002
WAYS = ("requests", "led")
READ, PLANNED = "read", "planned"
STEP_BACK = 2.0 * np.pi / 4096.0
"""rad, one step of a servo's encoder."""
STANDS_S, STANDS_RAD = 0.3, np.radians(0.1)
"""The leader is at a stop where it stayed this near for so long."""


@dataclass(frozen=True)
class PathErrors:
    """deg, of the encoders about the leader at the same time: RMS, the largest, RMS at stops, and how far a joint went
    beyond the leader's range at most; deg RMS, change of an encoder's step from frame to frame. `steps_back`: commands
    of a joint that go back by more than an encoder's step while the leader goes on by more."""

    rms: float
    largest: float
    at_stops: float
    beyond: float
    unrest: float
    steps_back: int


def sum_of_sines(t: Array, rng: np.random.Generator) -> Array:
    """(N, 5), rad: three sines a joint, 0.1 to 0.7 Hz; begins at rest at zero."""
    frequency = rng.uniform((0.1, 0.25, 0.5), (0.2, 0.45, 0.7), (ARM.dof, 3))
    size, phase = rng.uniform(0.5, 1.0, (ARM.dof, 3)) * (0.3, 0.15, 0.08), rng.uniform(0.0, 2.0 * np.pi, (ARM.dof, 3))
    swung = np.sin(2.0 * np.pi * frequency * t[:, None, None] + phase) * size
    return np.asarray(np.minimum(t / SETTLES_S, 1.0)[:, None] ** 2 * swung.sum(axis=2))


def pick_and_place(t: Array, rng: np.random.Generator) -> Array:
    """(N, 5), rad: moves of least jerk (Flash & Hogan 1985) of 0.6 to 1.2 s between stops of 0.5 to 1 s."""
    out, goal, begun = np.zeros((len(t), ARM.dof)), np.zeros(ARM.dof), SETTLES_S
    while begun < t[-1]:
        then, takes = rng.uniform(-0.6, 0.6, ARM.dof), rng.uniform(0.6, 1.2)
        s = np.clip((t - begun) / takes, 0.0, 1.0)[:, None]
        out = out + (then - goal) * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
        goal, begun = then, begun + takes + rng.uniform(0.5, 1.0)
    return out


PATHS: dict[str, Callable[[Array, np.random.Generator], Array]] = {
    "sum of sines": sum_of_sines, "pick and place": pick_and_place,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Leader:
    """A leader arm that goes along a path; its encoders flicker. `times`: (N,), s; `path`: (N, 5), rad."""

    times: Array
    path: Array
    rng: np.random.Generator

    @classmethod
    def along(cls, path: str, seed: int) -> Leader:
        """Along a path of `PATHS`."""
        rng, times = np.random.default_rng([64, seed]), np.arange(0.0, SECONDS, FINE_S)
        return cls(times, PATHS[path](times, rng), rng)

    def at(self, t: float) -> Array:
        """(5,), rad, where it is."""
        return np.array([np.interp(t, self.times, way) for way in self.path.T])

    def reading(self, t: float) -> Array:
        """(5,), rad, that its encoders read."""
        return np.radians(encoder_readings(np.degrees(self.at(t)), self.rng))


class SimulatedLine:
    """A serial line to a bus in simulated time. `now`: s."""

    def __init__(self, bus: FeetechBus) -> None:
        self.bus, self.now, self.said = bus, 0.0, b""

    def write(self, data: bytes) -> int:
        """Hands bytes to the bus."""
        self.said += self.bus.feed(data, self.now)
        return len(data)

    def read(self, size: int = 1) -> bytes:
        """What the bus answered."""
        out, self.said = self.said[:size], self.said[size:]
        return out

    @property
    def in_waiting(self) -> int:
        """Bytes to be read."""
        return len(self.said)


@dataclass(frozen=True, eq=False)
class Follower:
    """Servos and their time: `now` (s), and `wait` until a time (s)."""

    servos: BusServos
    now: Callable[[], float]
    wait: Callable[[float], None]


@contextmanager
def follower_in_simulated_time(dead_time: float) -> Iterator[Follower]:
    """Servos on a bus in this process."""
    numbers = range(1, ARM.dof + 1)
    line = SimulatedLine(FeetechBus([FeetechServo(number) for number in numbers], dead_time=dead_time))

    def wait(until: float) -> None:
        line.now = until

    yield Follower(held_servos("feetech", ServoHost(line, FEETECH), ARM, numbers), lambda: line.now, wait)


@contextmanager
def follower_at_pty(dead_time: float, speed: float) -> Iterator[Follower]:
    """Servos behind a device."""
    with (
        tempfile.TemporaryDirectory(prefix="lrm-") as folder,
        simulated_so101(Path(folder), "gain", 1, speed=speed, dead_time=dead_time) as link,
        connected_bus(f"feetech:{link},ids=1-{ARM.dof}", FEETECH, ARM) as servos,
    ):
        begun = time.monotonic()

        def now() -> float:
            return speed * (time.monotonic() - begun)

        yield Follower(servos, now, lambda until: time.sleep(max(0.0, until - now()) / speed))


@dataclass(frozen=True)
class Loop:
    """A loop of so many frames a second, whose frames begin early or late by `jitter` (s, RMS).

    `wishes`: `READ` from the leader at the moment of the frame, or `PLANNED` for a punctual one.
    """

    fps: int
    jitter: float
    wishes: str

    def frames(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """(N,), s, when frames of punctual loops begin, and when those of this one do."""
        even = np.arange(int(SECONDS * self.fps)) / self.fps
        return even, np.maximum.accumulate(even + self.jitter * rng.standard_normal(len(even)))


@dataclass(frozen=True, eq=False)
class Driven:
    """(N, 5), rad: where the leader is in each frame, what the follower's encoders read then, and the commands."""

    leader: Array
    seen: Array
    commands: Array


def driven(follower: Follower, arm: CorrectedArm, leader: Leader, loop: Loop, rng: np.random.Generator) -> Driven:
    """A follower that is driven by a loop."""
    there, seen, commands = list[Array](), list[Array](), list[list[float]]()
    arm.scale, arm.clock = np.ones(ARM.dof), follower.now
    for even, begins in zip(*loop.frames(rng), strict=True):
        follower.wait(begins)
        seen.append(np.array(follower.servos.angles()))
        there.append(leader.at(now := follower.now()))
        wish = leader.reading(even if loop.wishes == PLANNED else now)
        asked_for = arm.corrected(_action(arm, wish), partial(_action, arm, seen[-1]))
        commands.append([asked_for.action[key] for key in arm.keys])
        follower.servos.command(commands[-1])
        arm.follow(asked_for, asked_for.action)
    return Driven(np.array(there), np.array(seen), np.array(commands))


def _action(arm: CorrectedArm, q: Array) -> dict[str, float]:
    return dict(zip(arm.keys, q.tolist(), strict=True))


def errors(one: Driven, fps: int) -> PathErrors:
    """Of a follower's encoders about where the leader is."""
    wishes, seen = one.leader, one.seen
    off, frames = np.degrees(seen - wishes), math.ceil(STANDS_S * fps)
    stopped = np.ptp(np.lib.stride_tricks.sliding_window_view(wishes, frames, axis=0), axis=-1) < STANDS_RAD
    beyond = np.maximum(wishes.min(axis=0) - seen, seen - wishes.max(axis=0)).max()
    unrest = np.diff(np.degrees(seen), n=2, axis=0)
    rms = [float(np.sqrt(np.mean(x**2))) for x in (off, off[frames - 1 :][stopped], unrest)]
    goes_on, stepped = np.diff(wishes, axis=0), np.diff(one.commands, axis=0)
    back = int(((np.abs(goes_on) > STEP_BACK) & (np.sign(goes_on) * stepped < -STEP_BACK)).sum())
    return PathErrors(rms[0], float(np.abs(off).max()), rms[1], float(np.degrees(beyond)), rms[2], back)


def followed(path: str, dead_time: float, loop: Loop, seed: int, pty: float) -> dict[str, PathErrors]:
    """The errors along a path, by way of `WAYS`; `pty`: speed of the clock at a device, 0: simulated time."""
    motion = motion_model_with({f"dead_time.{place}.t_s": dead_time for place in ARM.joint_names})
    plain, out = Correction.of(model_of(ARM, ())), dict[str, PathErrors]()
    for way, correction in zip(WAYS, (plain, plain.in_motion(motion).led_by(motion)), strict=True):
        with follower_at_pty(dead_time, pty) if pty else follower_in_simulated_time(dead_time) as follower:
            rng = np.random.default_rng([65, seed])
            one = driven(follower, CorrectedArm(way, correction), Leader.along(path, seed), loop, rng)
            out[way] = errors(one, loop.fps)
    return out


def main() -> None:
    """Prints a row for each path and way."""
    chosen = asked(
        __doc__, dead_time=(0.05, "s, of every servo"), fps=Count(30), seed=0,
        jitter=(0.0, "s RMS, by which frames begin early or late"),
        wishes=(READ, "made for a punctual loop, or read from the leader in the frame", (READ, PLANNED)),
        pty=(0.0, "speed of the clock of a bus at a pty; 0: in this process, in simulated time"),
    )  # fmt: skip
    loop = Loop(chosen.fps, chosen.jitter, chosen.wishes)
    found = {path: followed(path, chosen.dead_time, loop, chosen.seed, chosen.pty) for path in PATHS}
    rows = [
        (path, way, *(f"{x:.2f}" if isinstance(x, float) else str(x) for x in vars(one).values()))
        for path, ways in found.items()
        for way, one in ways.items()
    ]
    head = ("path", "commands", "deg RMS", "largest", "at stops, RMS", "beyond", "unrest", "steps back")
    print(markdown_table(head, rows))


if __name__ == "__main__":
    main()
