"""Messages of the arm controller on zenoh: requests of clients, states and replies of the daemon; see docs/api.md."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import FailFast, Field, JsonValue, ValidationInfo, field_validator, model_validator

from lrmd.messages.codec import Header, Message, Part
from lrmd.messages.surroundings import MOST_OBSTACLES, ContactEntry, Label, ObstacleEntry, printable

Angles = Annotated[dict[Label, Annotated[float, Field(ge=-20, le=20)]], Field(max_length=16)]
Servos = Annotated[list[Label], Field(max_length=16)]
LoadCentre = Annotated[list[Annotated[float, Field(ge=-0.2, le=0.2)]], Field(min_length=3, max_length=3)]
"""m: no further from the tool than a hand holds something."""
Token = Annotated[str, Field(min_length=1, max_length=64)]
Stops = Annotated[int, Field(ge=0, lt=2**53)]
DeployedKind = Literal["model", "motion"]

# ---- requests of clients

LEASE_LOST = "lease lost"
"""Reason of the mode `holding` after a motion whose client did not renew its lease."""


class LeaseRequest(Message):
    """`rpc/lease`: acquire (with `holder`, and `take` to take it over), renew or release (with `lease`).

    `acquire` with `lease`, one that expired: refused if another client has had the lease since.
    """

    action: Literal["acquire", "renew", "release"]
    holder: Label = ""
    lease: Token | None = None
    take: bool = False


class CommandRequest(Message):
    """Request of the client that has the lease."""

    lease: Token


class MotionRequest(CommandRequest):
    """Request that may move something. `stops`: number of stops that its sender knows of; None: it does not say.

    One that knows of fewer than there were was made before the last stop, or without knowledge of it: it is refused.
    """

    stops: Stops | None = None


class ArmRequest(MotionRequest):
    """`rpc/arm`: switches servos on at their present position.

    `where` = "given": it is `q_rad`; "stored": the last one commanded (of `servos`, or all); "board": the registers of
    a board that is still pulsing.
    """

    where: Literal["given", "stored", "board"] = "board"
    q_rad: Angles = {}
    servos: Servos | None = None

    @field_validator("q_rad", "servos")
    @classmethod
    def _used(cls, value: Any, info: ValidationInfo) -> Any:
        only = "given" if info.field_name == "q_rad" else "stored"
        if value and info.data.get("where", only) != only:
            raise ValueError(f'goes with "where": "{only}" and with nothing else')
        return value


class MoveRequest(MotionRequest):
    """`rpc/move` and `cmd/target`: brings servos to each of the waypoints (rad), one after the other.

    `pace` = "together": all end at once; "each": each at its own full rate. `speed`: share of the full rate.
    `payload_kg`: what the gripper carries from now on. `may_touch`: contacts that this motion is permitted, at a tenth
    of the full rate. `shaping`: of the daemon's motion model against swing: "zv", or the more robust "zvd", "zvdd";
    "timed" for a coarse board; None: as configured. Only motions together are shaped.
    """

    waypoints: Annotated[list[Angles], FailFast(), Field(min_length=1, max_length=1000)]
    pace: Literal["together", "each"] = "together"
    speed: Annotated[float, Field(gt=0, le=1)] = 1.0
    payload_kg: Annotated[float, Field(ge=0, le=2)] | None = None
    may_touch: Annotated[list[ContactEntry], Field(max_length=8)] = []
    shaping: Literal["off", "zv", "zvd", "zvdd", "timed"] | None = None


class PayloadRequest(CommandRequest):
    """`rpc/payload`: the mass that the gripper carries from now on, and its centre. Nothing moves.

    `payload_centre_m`: where the centre of the load lies from where the arm file takes it, along the tool's axes.
    """

    payload_kg: Annotated[float, Field(ge=0, le=2)]
    payload_centre_m: LoadCentre = [0.0, 0.0, 0.0]


class JogRequest(MotionRequest):
    """`cmd/jog`: turns servos at these rates (rad/s) until the next one, at most for the command watchdog's time."""

    rate_rad_per_s: Angles


class HoldRequest(Message):
    """`rpc/hold`: stops the motion. Needs no lease."""


class RelaxRequest(CommandRequest):
    """`rpc/relax`: stops the pulses of some servos, or all. The arm falls under gravity."""

    servos: Servos | None = None


class DisarmRequest(CommandRequest):
    """`rpc/disarm`: stops all pulses of a stationary arm."""


class ResetRequest(CommandRequest):
    """`rpc/reset_fault`: leaves fault or estop. Nothing moves."""


class ReloadRequest(Message):
    """`rpc/reload`: reads the model file again. Nothing moves; needs no lease."""


class DeployRequest(Message):
    """`rpc/deploy`: a model file's `text`, kept as a new version and used at once. Nothing moves; needs no lease.

    `kind`: a "model" of poses, or one of "motion", which counts from the next motion on. `accept`: also a model of
    poses that moves the tip by more than a fifth of the reach, at the same commands.
    """

    text: Annotated[str, Field(min_length=1, max_length=1_000_000)]
    accept: bool = False
    kind: DeployedKind = "model"


class UndeployRequest(Message):
    """`rpc/undeploy`: back to the model of this `kind` before its last deployment. Nothing moves; needs no lease."""

    kind: DeployedKind = "model"


class EstopCommand(Message):
    """`cmd/estop`: stops all pulses at the next tick. Needs no lease; `why` is for the log."""

    why: Label = ""


class GravityCommand(Message):
    """`cmd/gravity`: gravity in the arm's frame (m/s²), from an accelerometer. Needs no lease.

    Only its direction counts. An accelerometer at rest reads the opposite.
    """

    gravity_m_per_s2: Annotated[list[Annotated[float, Field(ge=-11, le=11)]], Field(min_length=3, max_length=3)]


class SceneCommand(Message):
    """`cmd/scene`: obstacles of an `owner`, by name: `put` adds or moves them, `remove` forgets them. Needs no lease.

    `max_age_s`: those that are put are dropped after so long; None: never.
    """

    owner: Annotated[str, Field(min_length=1, max_length=64)]
    put: Annotated[list[ObstacleEntry], FailFast(), Field(max_length=MOST_OBSTACLES)] = []
    remove: Annotated[list[Label], FailFast(), Field(max_length=MOST_OBSTACLES)] = []
    max_age_s: Annotated[float, Field(gt=0, le=86_400)] | None = 10.0

    @field_validator("owner")
    @classmethod
    def _shown(cls, value: str) -> str:
        return printable(value)


REQUESTS: dict[str, type[Message]] = {
    "rpc/lease": LeaseRequest,
    "rpc/arm": ArmRequest,
    "rpc/move": MoveRequest,
    "rpc/payload": PayloadRequest,
    "rpc/hold": HoldRequest,
    "rpc/relax": RelaxRequest,
    "rpc/disarm": DisarmRequest,
    "rpc/reset_fault": ResetRequest,
    "rpc/reload": ReloadRequest,
    "rpc/deploy": DeployRequest,
    "rpc/undeploy": UndeployRequest,
}
MODELS = ("rpc/reload", "rpc/deploy", "rpc/undeploy")
"""Requests that take long: one at a time, of all of them."""
COMMANDS: dict[str, type[Message]] = {
    "cmd/target": MoveRequest,
    "cmd/jog": JogRequest,
    "cmd/gravity": GravityCommand,
    "cmd/scene": SceneCommand,
}
"""Requests without a reply: what is wrong with one is told by an event."""


# ---- messages of the daemon


class JointsState(Header):
    """`state/joints`, 50 Hz: one entry per servo. `q_rad` is commanded; there is no feedback. `on`: it has pulses."""

    names: list[str]
    q_rad: list[float]
    target_rad: list[float]
    pulse_us: list[float]
    on: list[bool]
    moving: bool
    remaining_s: float


class ModeState(Header):
    """`state/mode`, when it changes and every second. `troubles`: what keeps the arm from being armed.

    `stops`: number of holds, emergency stops, disarmings and faults since the start; see `MotionRequest`.
    """

    mode: str
    why: str
    since_mono_ns: int
    holder: str | None
    link: str
    payload_kg: float
    payload_centre_m: list[float]
    stops: int
    troubles: list[str] = []


class FaultEntry(Part):
    """One fault: its code, what happened, since when (monotonic ns)."""

    code: str
    text: str
    since_mono_ns: int


class FaultsState(Header):
    """`state/faults`, when it changes and every second: latched faults."""

    faults: list[FaultEntry]


class ThermalState(Header):
    """`state/thermal`, 1 Hz, per servo; `hot_in_s`: time until it is hot under constant torque, None: never.

    `powered_s`: for how long the joints have had pulses, None without; `powered_at_c`: the hottest temperature then.
    """

    names: list[str]
    temperature_c: list[float]
    tau_nm: list[float]
    level: list[str]
    hot_in_s: list[float | None]
    powered_s: float | None = None
    powered_at_c: float | None = None


class GravityState(Header):
    """`state/gravity`, 1 Hz: gravity in use, in the arm's frame.

    `source`: the "model" with its arm file, or "told" by `cmd/gravity`. `age_s`: since the last one was told, or None.
    """

    gravity_m_per_s2: list[float]
    source: Literal["model", "told"]
    age_s: float | None


class ObstacleState(Part):
    """An obstacle that the guard knows: `age_s` since it was told, `left_s` until it is dropped, None: never."""

    name: str
    owner: str
    age_s: float
    left_s: float | None


class SceneState(Header):
    """`state/scene`, 1 Hz: obstacles that `cmd/scene` told of."""

    obstacles: list[ObstacleState]


class MetricsState(Header):
    """`state/metrics`, 1 Hz: lateness of the ramp since its start, as a histogram and quantiles, and link statistics.

    `late_counts[i]`: ticks from edge `late_upper_us[i - 1]` to edge i; the last one: beyond all edges.
    """

    ticks: int
    skipped: int
    late_upper_us: Annotated[list[float], Field(min_length=1, max_length=64)]
    late_counts: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=2, max_length=65)]
    late_p50_us: float
    late_p99_us: float
    late_p999_us: float
    late_max_us: float
    realtime: bool
    duty: float
    frames_sent: int
    frames_acknowledged: int
    bad_frames: int
    board_errors: int
    reconnects: int
    ramp_starts: int
    ik_starts: int

    @model_validator(mode="after")
    def _one_histogram(self) -> Self:
        if len(self.late_counts) != len(self.late_upper_us) + 1:
            raise ValueError("late_counts has one more entry than late_upper_us")
        if any(b <= a for a, b in pairwise(self.late_upper_us)):
            raise ValueError("late_upper_us ascends")
        if sum(self.late_counts) != self.ticks:
            raise ValueError("late_counts adds up to ticks")
        return self


class InfoState(Header):
    """`info`: configuration of the arm. `model_sha256`: of the loaded model file, empty for the nominal arm.

    `step_us`: largest change of a commanded pulse in one tick. The board rounds it to `count_us` at `pwm_hz`,
    if its oscillator has `oscillator_hz` as configured. `motion_model`, `motion_sha256`: file of the motion model in
    use, None and empty without one. With one, moves are shaped as `shaping` says unless they say otherwise, and
    `rpc/move` states when the tip stays `within_m` of its rest.
    """

    robot: str
    arm: str
    version: str
    names: list[str]
    joints: int
    limits_rad: list[list[float]]
    rate_rad_per_s: list[float]
    tables_rad: list[list[float]]
    tables_us: list[list[float]]
    tick_ms: float
    step_us: float
    count_us: float
    pwm_hz: float
    oscillator_hz: float
    lease_ms: float
    command_ms: float
    model: str | None
    model_sha256: str
    stored_rad: dict[str, float]
    stored_still: bool
    motion_model: str | None = None
    motion_sha256: str = ""
    shaping: Literal["off", "zv", "zvd", "zvdd", "timed"] = "off"
    within_m: float | None = None


class Event(Header):
    """`event/<code>`: an event of the daemon."""

    code: str
    level: Literal["info", "warning", "error"]
    text: str
    detail: dict[str, JsonValue] = {}


class Reply(Header):
    """Reply to a request that was carried out: the resulting mode. `model_sha256`: empty for the nominal arm;
    `unchecked`: why the motion that `rpc/move` began was not checked for collisions, empty if it was. `stops`: as in
    `state/mode`; None from `rpc/estop`, whose process does not count. `settle_s`: from `rpc/move` with a motion model:
    time after `seconds` until the tip usually stays within `within_m` of its rest, `settle_95_s` until it does so in
    95 % of the cases that are simulated. `skill`: number of the skill that began."""

    mode: str
    stops: int | None = None
    lease: str | None = None
    lease_ms: float | None = None
    seconds: float | None = None
    model_sha256: str = ""
    unchecked: str = ""
    skill: int | None = None
    settle_s: float | None = None
    settle_95_s: float | None = None
    within_m: float | None = None


class FieldPart(Part):
    """A residual field, which is compensated and is not a cause: shares of the poses within the joint limits.

    `effect`: its name, marked. `speaks_share`: where the data determine it; None if the file has no covariance.
    `outside_share`: with a joint outside the range that the model was fitted on, where it fades to zero.
    """

    effect: str
    speaks_share: float | None
    outside_share: float


class ReloadReply(Header):
    """Reply to `rpc/reload`, `rpc/deploy` and `rpc/undeploy`: the model, as in later replies of `rpc/ik`.

    `field`: its residual field; None without one. `tip_moves_m`, `tip_moves_rms_m`: of a deployment, how far the tip
    moves at most, and RMS, against the model before it, at the same commands. `motion_model`, `motion_sha256`: as in
    `info`.
    """

    model: str
    model_sha256: str
    motion_model: str | None = None
    motion_sha256: str = ""
    left_out: list[str] = []
    field: FieldPart | None = None
    tip_moves_m: float | None = None
    tip_moves_rms_m: float | None = None
