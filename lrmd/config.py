"""The daemon's configuration file `lrmd.toml`, read into a frozen `Config`: times and pulses in ns, angles in rad."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MICROSECOND, Angle, load_arm
from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD
from lrm_math.arm.servo_table import PwmClock, ServoTable
from lrm_math.errors import FileError, LrmError, UnknownName, name_suggestion
from lrm_math.toml_file import StrictSchema, read_toml

_BESIDE = Path(__file__).resolve().parent / "lrmd.toml"
SHIPPED = _BESIDE if _BESIDE.is_file() else _BESIDE.parents[1] / "config" / "lrmd.toml"
"""The configuration that comes with the software: in a wheel beside this file."""
SECOND, MS, US = 1_000_000_000, 1_000_000, 1_000
"""Nanoseconds in a second, a millisecond and a microsecond."""

SHORTEST_PULSE, LONGEST_PULSE = 100 * US, 3000 * US
"""ns: no servo takes a shorter one; a table with one is in another unit, or has too wide a range."""
LONGER_TICK = 0.05
"""Share by which a tick may be longer than `tick_ms` so that a frame of the board is whole ticks long."""

HOST_PROTOCOLS = ("tcp", "udp", "tls", "quic", "ws")
"""zenoh's protocols whose addresses are a host and a port; it takes no capitals."""
HOST_AND_PORT = re.compile(r"(?:\[[^\]\[\s]+\]|[^\]\[:/\s]+):([0-9]{1,5})")
"""A name, an IPv4 address or an IPv6 address in brackets, and the port."""


def _with_port(endpoint: str) -> str:
    """An endpoint of zenoh; zenoh itself waits for an address without a port until its time is over."""
    given, slash, address = endpoint.partition("/")
    protocol = given.lower()
    if not (given and slash and address):
        raise ValueError("PROTOCOL/ADDRESS, for instance tcp/127.0.0.1:7447")
    if protocol not in HOST_PROTOCOLS:
        return endpoint
    match = HOST_AND_PORT.fullmatch(re.split("[?#]", address)[0])
    if given != protocol or match is None or not 0 < int(match[1]) <= 65_535:
        raise ValueError(f"{protocol}/HOST:PORT, for instance {protocol}/127.0.0.1:7447 or {protocol}/[::1]:7447")
    return endpoint


Milliseconds = Annotated[float, Field(ge=1, le=60_000)]
Celsius = Annotated[float, Field(ge=-50, le=150)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]
PathText = Annotated[str, Field(min_length=1, pattern=r"^[^\x00]*$")]
Endpoint = Annotated[str, AfterValidator(_with_port)]


class LinkTable(StrictSchema):
    """`[link]`: the serial line and the board's clock."""

    port: PathText
    baud: Annotated[int, Field(ge=9600, le=4_000_000)] = 115_200
    pwm_hz: Annotated[float, Field(gt=0)] = 50.0
    oscillator_hz: Annotated[float, Field(ge=20e6, le=30e6)] = 25e6
    silence_ms: Annotated[int, Field(ge=50, le=10_000)] = 1000
    reply_ms: Milliseconds = 490.0


class RampTable(StrictSchema):
    """`[ramp]`: tick and step of the pulses' staircase, and the process's SCHED_FIFO priority."""

    tick_ms: Annotated[float, Field(ge=1.0, le=100.0)] = 6.5
    step_us: Annotated[float, Field(ge=0.01, le=10.0)] = 1.0
    realtime_priority: Annotated[int, Field(ge=0, le=50)] = 50


class ServoEntry(StrictSchema):
    """`[servo.NAME]`: channel of the board; a level-1 table where the arm file has none for this servo."""

    channel: Annotated[int, Field(ge=0, le=15)]
    angle_deg: list[Angle] | None = None
    pulse_us: list[Annotated[float, Field(gt=0, lt=20_000)]] | None = None


class SafetyTable(StrictSchema):
    """`[safety]`: timeouts of commands and leases, delay between servos that are switched on, rest pose, torque that a
    servo without pulses bears, tip-over angle that motions keep."""

    command_ms: Milliseconds = 500.0
    lease_ms: Annotated[float, Field(ge=100, le=500)] = 400.0
    stagger_ms: Milliseconds = 200.0
    rest_q_deg: list[Angle] | None = None
    unpowered_nm: Annotated[float, Field(ge=0, le=10)] = 0.05
    tip_over_deg: Annotated[float, Field(ge=0, le=80)] | None = None


class ThermalTable(StrictSchema):
    """`[thermal]`: first-order model of the winding temperature, T -> ambient + rise * tau^2."""

    ambient_c: Celsius = 25.0
    time_constant_s: Annotated[float, Field(gt=0)] = 900.0
    derate_c: Celsius = 70.0
    rest_c: Celsius = 85.0
    off_c: Celsius = 95.0
    rise_k_per_nm2: dict[str, Annotated[float, Field(ge=0)]] = {}


class GravityTable(StrictSchema):
    """`[gravity]`: how long a direction that `cmd/gravity` told is used, and what is used then."""

    max_age_s: Annotated[float, Field(gt=0, le=86_400)] = 10.0
    fallback: Literal["model", "last"] = "model"


class StateTable(StrictSchema):
    """`[state]`: directory of the state file, and the interval between two writes during a motion."""

    directory: PathText
    save_ms: Milliseconds = 500.0


class MotionTable(StrictSchema):
    """`[motion]`: a motion model of the arm, while none is deployed; the distance within which its tip is at rest, and
    how moves are shaped where there is a model."""

    model: PathText | None = None
    within_mm: Annotated[float, Field(ge=0.001, le=100)] = 0.1
    shaping: Literal["off", "zv", "zvd", "zvdd", "timed"] = "off"


class SpringEntry(StrictSchema):
    """`[simulation.spring.JOINT]`: the link swings on a spring behind its servo, and sticks and slips by friction."""

    stiffness_nm_per_rad: Annotated[float, Field(ge=0.1, le=1e5)]
    damping_nm_s_per_rad: Annotated[float, Field(ge=0, le=1e3)]
    friction_nm: Annotated[float, Field(ge=0, le=1e3)] = 0.0


class SimulationTable(StrictSchema):
    """`[simulation]`: what the arm of `lrmd --simulated` is like; without springs its links stand as its servos do."""

    spring: dict[str, SpringEntry] = {}


class ZenohTable(StrictSchema):
    """`[zenoh]`: endpoints, and a configuration file of zenoh's own."""

    listen: Annotated[list[Endpoint], Field(min_length=1)] = ["tcp/127.0.0.1:7447"]
    connect: list[Endpoint] = []
    config: PathText | None = None


class DaemonFile(StrictSchema):
    """The whole file, schema `lrm/daemon/1`."""

    schema_: Literal["lrm/daemon/1"] = Field(alias="schema")
    robot: Name
    arm: PathText
    model: PathText | None = None
    link: LinkTable
    ramp: RampTable = RampTable()
    servo: dict[str, ServoEntry]
    safety: SafetyTable = SafetyTable()
    thermal: ThermalTable = ThermalTable()
    gravity: GravityTable = GravityTable()
    state: StateTable
    motion: MotionTable = MotionTable()
    simulation: SimulationTable = SimulationTable()
    zenoh: ZenohTable = ZenohTable()


@dataclass(frozen=True)
class ServoConfig:
    """A servo of the board: `channel` 0 to 15, level-1 `table`, lowest and highest pulse (ns)."""

    name: str
    channel: int
    table: ServoTable
    lowest: int
    highest: int

    def pulse_ns(self, angle: float) -> int:
        """Pulse (ns) of an angle (rad)."""
        return round(float(self.table.pulse_of(angle)) * 1e9)

    def angle(self, pulse_ns: int) -> float:
        """Angle (rad) of a pulse (ns)."""
        return float(self.table.angle_of(pulse_ns * 1e-9))


@dataclass(frozen=True)
class Config:
    """The checked configuration. Servos in the order joint1 … jointN, then the others as in the file.

    `arm_file`: the name or path that `arm` was read from.
    `tick`, `reply`, `command`, `lease`, `stagger`, `save`, `gravity_age`: ns. `step`: ns of pulse in one tick.
    `gravity_keeps_last`: whether a direction of gravity that is older is used still, instead of the model's.
    `rest`: rad, one angle per joint, or None. `unpowered`: N·m that a servo without pulses bears.
    `tip_over`: rad, angle to tipping over that motions keep, or None.
    `rise`: K/(N·m)², one per servo, 0 where not configured.
    """

    robot: str
    arm: Arm
    arm_file: str
    model: Path | None
    link: LinkTable
    clock: PwmClock
    servos: tuple[ServoConfig, ...]
    tick: int
    step: int
    realtime_priority: int
    reply: int
    command: int
    lease: int
    stagger: int
    rest: tuple[float, ...] | None
    unpowered: float
    tip_over: float | None
    thermal: ThermalTable
    rise: tuple[float, ...]
    gravity_age: int
    gravity_keeps_last: bool
    state: Path
    save: int
    zenoh: ZenohTable
    motion: MotionTable
    simulation: SimulationTable

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the servos."""
        return tuple(servo.name for servo in self.servos)

    def index(self, name: str) -> int:
        """Index of a servo by its name. Raises `UnknownName`."""
        try:
            return self.names.index(name)
        except ValueError:
            raise UnknownName("servo", name, self.names) from None

    @property
    def dof(self) -> int:
        """Number of joints: the first `dof` servos."""
        return len(self.arm.joints)


def load_config(path: Path) -> Config:
    """Reads and checks the configuration file and the arm file that it names. Raises `FileError`."""
    tables = read_toml(path, DaemonFile)
    try:
        arm = load_arm(tables.arm)
    except FileError as error:
        raise error if error.path.endswith(".toml") else FileError(path, "arm", str(error)) from None
    try:
        return _config(tables, arm)
    except LrmError as error:
        raise FileError(path, "", str(error)) from None


def _config(t: DaemonFile, arm: Arm) -> Config:
    servos = _servos(t, arm)
    rest = t.safety.rest_q_deg
    if rest is not None:
        _check_rest(arm, rest)
    if not t.thermal.ambient_c < t.thermal.derate_c < t.thermal.rest_c < t.thermal.off_c:
        raise LrmError("thermal: ambient_c < derate_c < rest_c < off_c must hold")
    if t.safety.tip_over_deg is not None and (arm.vehicle is None or not any(arm.gravity)):
        raise LrmError(f"safety: tip_over_deg needs a [vehicle] and gravity in the arm file of {arm.name}")
    unknown = set(t.thermal.rise_k_per_nm2) - set(arm.joint_names)
    if unknown:
        name = sorted(unknown)[0]
        raise LrmError(f"thermal rise_k_per_nm2: unknown joint {name}; {name_suggestion(name, arm.joint_names)}")
    if t.link.silence_ms <= 2 * t.link.reply_ms:
        raise LrmError(f"link: silence_ms = {t.link.silence_ms} must be more than twice reply_ms = {t.link.reply_ms:g}")
    if t.link.reply_ms < 2 * t.ramp.tick_ms:
        raise LrmError(f"link: reply_ms = {t.link.reply_ms:g} must be at least twice tick_ms = {t.ramp.tick_ms:g}")
    for name in t.simulation.spring:
        if name not in arm.joint_names:
            raise LrmError(f"simulation: unknown joint {name}; {name_suggestion(name, arm.joint_names)}")
    clock = PwmClock(t.link.pwm_hz, t.link.oscillator_hz)
    for servo in servos:
        _check_fits(servo, clock)
    return Config(
        robot=t.robot, arm=arm, arm_file=t.arm, model=None if t.model is None else Path(t.model),
        link=t.link, clock=clock, servos=servos, reply=round(t.link.reply_ms * MS),
        tick=_tick(t, clock), step=round(t.ramp.step_us * US), realtime_priority=t.ramp.realtime_priority,
        command=round(t.safety.command_ms * MS), lease=round(t.safety.lease_ms * MS),
        stagger=round(t.safety.stagger_ms * MS), rest=None if rest is None else tuple(map(math.radians, rest)),
        unpowered=t.safety.unpowered_nm,
        tip_over=None if t.safety.tip_over_deg is None else math.radians(t.safety.tip_over_deg),
        thermal=t.thermal, rise=tuple(t.thermal.rise_k_per_nm2.get(servo.name, 0.0) for servo in servos),
        gravity_age=round(t.gravity.max_age_s * SECOND), gravity_keeps_last=t.gravity.fallback == "last",
        state=Path(t.state.directory), save=round(t.state.save_ms * MS), zenoh=t.zenoh, motion=t.motion,
        simulation=t.simulation,
    )  # fmt: skip


def _tick(t: DaemonFile, clock: PwmClock) -> int:
    """ns of a tick: `tick_ms`, or with `timed` moves up to `LONGER_TICK` more, so that a frame is whole ticks long.

    The waits of such moves then hit the board's frames. A tick is never shorter than `tick_ms`.
    """
    tick, frame = t.ramp.tick_ms * MS, COUNTS_PER_PERIOD * clock.count_s * SECOND
    whole = frame / max(math.floor(frame / tick), 1)
    fits = t.motion.shaping == "timed" and tick < whole <= (1.0 + LONGER_TICK) * tick
    return math.ceil(whole) if fits else round(tick)


def _servos(t: DaemonFile, arm: Arm) -> tuple[ServoConfig, ...]:
    missing = [name for name in arm.joint_names if name not in t.servo]
    if missing:
        raise LrmError(f"servo: no [servo.{missing[0]}] with its channel; every joint of {arm.name} needs one")
    names = [*arm.joint_names, *(name for name in t.servo if name not in arm.joint_names)]
    owner: dict[int, str] = {}
    for name in names:
        channel = t.servo[name].channel
        if channel in owner:
            raise LrmError(f"servo {name}: channel {channel} is already that of {owner[channel]}")
        owner[channel] = name
    return tuple(_servo(name, t.servo[name], arm) for name in names)


def _servo(name: str, entry: ServoEntry, arm: Arm) -> ServoConfig:
    table = _table(name, entry, arm)
    if name in arm.joint_names:
        joint = arm.joints[arm.joint_names.index(name)]
        lower, upper = joint.lower, joint.upper
    else:
        lower, upper = table.angle[0], table.angle[-1]
    lowest, highest = sorted(round(float(table.pulse_of(angle)) * 1e9) for angle in (lower, upper))
    if lowest < SHORTEST_PULSE or highest > LONGEST_PULSE:
        bounds = f"never below {SHORTEST_PULSE // US} or above {LONGEST_PULSE // US}"
        ends = f"are {lowest / US:g} to {highest / US:g} us long"
        raise LrmError(f"servo {name}: its pulses {ends}; servos take 500 to 2500 us, {bounds}")
    return ServoConfig(name, entry.channel, table, lowest, highest)


def _table(name: str, entry: ServoEntry, arm: Arm) -> ServoTable:
    if (entry.angle_deg is None) != (entry.pulse_us is None):
        raise LrmError(f"servo {name}: angle_deg and pulse_us belong together")
    if entry.angle_deg is not None and entry.pulse_us is not None:
        try:
            return ServoTable(tuple(map(math.radians, entry.angle_deg)), tuple(p * MICROSECOND for p in entry.pulse_us))
        except LrmError as error:
            raise LrmError(f"servo {name}: {error}") from None
    numbers_by_name = dict(arm.auxiliary_servos)
    numbers_by_name |= {n: j.servo for n, j in zip(arm.joint_names, arm.joints, strict=True) if j.servo is not None}
    if name not in numbers_by_name:
        raise LrmError(
            f"servo {name}: neither a table in the arm file nor angle_deg and pulse_us here; "
            f"the arm file knows {', '.join(numbers_by_name) or 'none'}"
        )
    return numbers_by_name[name]


def _check_fits(servo: ServoConfig, clock: PwmClock) -> None:
    try:
        clock.counts_of([servo.lowest * 1e-9, servo.highest * 1e-9])
    except LrmError as error:
        text = f"{error}; its longest pulse is {servo.highest / US:g} us: lower pwm_hz"
        raise LrmError(f"servo {servo.name}: {text}") from None


def _check_rest(arm: Arm, rest: list[float]) -> None:
    if len(rest) != arm.dof:
        raise LrmError(f"safety: rest_q_deg has {len(rest)} angles; {arm.name} has {arm.dof} joints")
    for name, joint, angle in zip(arm.joint_names, arm.joints, rest, strict=True):
        if not joint.lower <= math.radians(angle) <= joint.upper:
            low, high = math.degrees(joint.lower), math.degrees(joint.upper)
            raise LrmError(f"safety: rest_q_deg of {name} is {angle:g}; must be {low:g} to {high:g}")
