"""Messages of the ik process: requests and replies in m and rad, in the frame of the arm's base."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import FailFast, Field, model_validator

from lrmd.messages.codec import Header, Message, Part
from lrmd.messages.surroundings import ContactEntry, Coordinate, Label, Position

JointAngle = Annotated[float, Field(ge=-20, le=20)]
JointAngles = Annotated[list[JointAngle], Field(min_length=1, max_length=16)]
Directions = Annotated[list[Annotated[int, Field(ge=-1, le=1)]], Field(min_length=1, max_length=16)]
Payload = Annotated[float, Field(ge=0, le=2)]
Deadline = Annotated[float, Field(gt=0, le=60_000)]


class GoalEntry(Part):
    """Goal of the tool: `position_m`, and at most one of the others; without any the orientation is free.

    `rpy_rad`: rotations about the fixed x, then y, then z axis. `approach`: direction of the tool's z axis.
    """

    position_m: Position
    rpy_rad: Annotated[list[JointAngle], Field(min_length=3, max_length=3)] | None = None
    quaternion_xyzw: Annotated[list[Coordinate], Field(min_length=4, max_length=4)] | None = None
    approach: Position | None = None

    @model_validator(mode="after")
    def _at_most_one(self) -> GoalEntry:
        given = [n for n in ("rpy_rad", "quaternion_xyzw", "approach") if getattr(self, n) is not None]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} are both given; give one of them, or none")
        return self


class KinematicsRequest(Message):
    """Query of the ik process. `payload_kg`: None for what the arm carries; `id`: for `rpc/cancel`.
    `may_touch`: contacts that the motion will be permitted."""

    id: Label = ""
    payload_kg: Payload | None = None
    deadline_ms: Deadline = 10_000.0
    may_touch: Annotated[list[ContactEntry], Field(max_length=8)] = []

    def with_payload(self, carried: float) -> Self:
        """The request with what the arm carries (kg), unless it says so: a plan then is that of the next move."""
        return self if self.payload_kg is not None else self.model_copy(update={"payload_kg": carried})


class IkRequest(KinematicsRequest):
    """`rpc/ik`: inverse kinematics of goals; branches near the present pose `near_rad` come first.

    `round`: "each" joint to its nearest count, or the "best" combination of neighbouring counts.
    """

    goals: Annotated[list[GoalEntry], FailFast(), Field(min_length=1, max_length=1000)]
    near_rad: JointAngles | None = None
    method: Literal["cube", "direct", "iterative"] = "cube"
    cube_side_m: Annotated[float, Field(gt=0, le=0.2)] = 0.01
    cube_points: Annotated[int, Field(ge=2, le=21)] = 11
    round: Literal["each", "best"] = "each"
    deadline_ms: Deadline = 1000.0


class FkRequest(KinematicsRequest):
    """`rpc/fk`: forward kinematics of the sagging arm for commanded angles.

    Each row is taken to be reached straight from where the arm stands, after the moves that the daemon has recorded.
    `near_rad`: from there instead, by a long move. `direction`: of each row, the sign of the last move of every joint,
    a long one; 0: not known.
    """

    q_rad: Annotated[list[JointAngles], FailFast(), Field(min_length=1, max_length=1000)]
    near_rad: JointAngles | None = None
    direction: Annotated[list[Directions], FailFast(), Field(max_length=1000)] = []

    @model_validator(mode="after")
    def _one_origin(self) -> FkRequest:
        if self.direction and self.near_rad is not None:
            raise ValueError("near_rad and direction are both given; give one of them, or none")
        if self.direction and len(self.direction) != len(self.q_rad):
            raise ValueError(f"direction has {len(self.direction)} rows, q_rad {len(self.q_rad)}; give one for each")
        return self


class PlanRequest(KinematicsRequest):
    """`rpc/plan`: a collision-free path from `from_rad` to `to_rad`, or to a goal; deterministic for one `seed`.

    `line`: the tip goes straight to the goal, the tool turning evenly; to its orientation, or not at all. `stabilise`:
    to a pose in which the vehicle is further from tipping over, the furthest that is found.
    """

    from_rad: JointAngles
    to_rad: JointAngles | None = None
    goal: GoalEntry | None = None
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    line: bool = False
    stabilise: bool = False

    @model_validator(mode="after")
    def _one_end(self) -> PlanRequest:
        if self.line and self.goal is None:
            raise ValueError("a line goes to a goal, not to to_rad")
        if (self.to_rad is not None) + (self.goal is not None) + self.stabilise != 1:
            raise ValueError("give to_rad or goal, one of them, or stabilise")
        return self


class CancelRequest(Message):
    """`rpc/cancel`: cancels the requests of this `id`."""

    id: Annotated[str, Field(min_length=1, max_length=64)]


class IkAnswer(Part):
    """Result for one goal.

    If solved: `q_rad` are the commands, `branches_rad` all solutions within the limits and free of collision, `tcp_m`
    the predicted tool position, `sd_m` its standard deviation (None without covariance), `counts` the PWM counts with
    `rounded_error_m` and `rounded_turn_rad`, `direction` the side from which each joint has to arrive (0: either),
    `detours` the joints that would not, `cube_error_m` the error before the polish. `free_joints`: for each branch the
    joint, from 1, that can turn while the tool hardly moves, the others following: a singular pose, the branch is one
    of a family; 0: none. Else `nearest_rad`, the command nearest to the goal, or the two `bodies` of a collision and
    their `clearance_m` (overlap below 0). `outside_range`: joints, from 1, that `q_rad` or `nearest_rad` puts outside
    the range that the model was fitted on; there its error is not known. `tip_over_rad`: as of `FkAnswer`, at the same
    commands.
    """

    verdict: Literal["solved", "out_of_reach", "outside_limits", "not_converged", "collision"]
    text: str
    q_rad: list[float] | None = None
    branches_rad: list[list[float]] = []
    free_joints: list[int] = []
    tcp_m: list[float] | None = None
    predicted_error_m: float | None = None
    predicted_turn_rad: float | None = None
    sd_m: float | None = None
    counts: list[int] | None = None
    rounded_q_rad: list[float] | None = None
    rounded_error_m: float | None = None
    rounded_turn_rad: float | None = None
    direction: list[int] = []
    detours: list[int] = []
    cube_error_m: float | None = None
    nearest_rad: list[float] | None = None
    nearest_distance_m: float | None = None
    bodies: list[str] = []
    clearance_m: float | None = None
    outside_range: list[int] = []
    tip_over_rad: float | None = None
    elapsed_ms: float


class KinematicsReply(Header):
    """Reply of the ik process. `model_sha256`: of the model file in use, empty for the nominal arm."""

    model: str
    model_sha256: str
    elapsed_ms: float


class IkReply(KinematicsReply):
    """Answers in the order of the goals. `residual_m`: RMS error that the model left at the poses of its fit."""

    left_out: list[str]
    answers: Annotated[list[IkAnswer], Field(max_length=1000)]
    residual_m: float = 0.0


class PlanReply(KinematicsReply):
    """A path of straight moves through `waypoints_rad`, the start included; empty if none was found, see `text`.

    Waypoints are the corners of the path and the points where a joint passes a point of its level-1 table, so that
    moves which are straight in pulses are straight in angles. `ends_at_m`: where a line ends that does not go on.
    `tip_over_rad`: as of `FkAnswer`, at the start and at the end; empty where the arm file has no vehicle.
    """

    found: bool
    text: str
    waypoints_rad: Annotated[list[list[float]], Field(max_length=4000)] = []
    ends_at_m: list[float] | None = None
    tip_over_rad: Annotated[list[float], Field(max_length=2)] = []


class FkAnswer(Part):
    """Tool pose: position, rows of its rotation matrix; gravity torque on every joint; standard deviation.

    `outside_range`: joints, from 1, outside the range that the model was fitted on. `direction`: the sign of each
    joint's last move that the answer is for, 0 where it is not known. `tip_over_rad`: how far gravity may turn until
    the vehicle tips over; None where the arm file has no vehicle.
    """

    tcp_m: list[float]
    rotation: list[list[float]]
    tau_nm: list[float]
    sd_m: float | None
    outside_range: list[int] = []
    direction: list[int] = []
    tip_over_rad: float | None = None


class FkReply(KinematicsReply):
    """One answer for every row of angles."""

    left_out: list[str]
    places: Annotated[list[FkAnswer], Field(max_length=1000)]


REQUESTS: dict[str, type[KinematicsRequest]] = {"rpc/ik": IkRequest, "rpc/fk": FkRequest, "rpc/plan": PlanRequest}
CANCEL = "rpc/cancel"
