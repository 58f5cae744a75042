"""Messages of the ik process: goals and answers. Positions in m, angles in rad, in the frame of the arm's base."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from lrmd.messages.control import Header, Label, Message, Part

Coordinate = Annotated[float, Field(ge=-100, le=100)]
Point = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]
Joint = Annotated[float, Field(ge=-20, le=20)]
Joints = Annotated[list[Joint], Field(min_length=1, max_length=16)]
Payload = Annotated[float, Field(ge=0, le=2)]


class GoalEntry(Part):
    """Where the tool shall be: `position_m`, and at most one of the others; without any the orientation is free.

    `rpy_rad`: turns about the fixed x, then y, then z axis. `quaternion_xyzw`: a unit quaternion. `approach`: direction
    that the tool's z axis shall point along, of any length but zero.
    """

    position_m: Point
    rpy_rad: Annotated[list[Joint], Field(min_length=3, max_length=3)] | None = None
    quaternion_xyzw: Annotated[list[Coordinate], Field(min_length=4, max_length=4)] | None = None
    approach: Point | None = None

    @model_validator(mode="after")
    def _at_most_one(self) -> GoalEntry:
        given = [n for n in ("rpy_rad", "quaternion_xyzw", "approach") if getattr(self, n) is not None]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} are both given; give one of them, or none")
        return self


class IkRequest(Message):
    """`rpc/ik`: goals to commanded angles.

    `near_rad`: where the arm stands; branches nearest to it come first. `method` and, for the cube, its side and its
    points along each edge. `round`: "each" joint to its nearest count, or the "best" combination of neighbouring
    counts. `deadline_ms`: later than this nobody wants the answer. `id`: what `rpc/cancel` calls the request.
    """

    id: Label = ""
    goals: Annotated[list[GoalEntry], Field(min_length=1, max_length=1000)]
    payload_kg: Payload = 0.0
    near_rad: Joints | None = None
    method: Literal["cube", "direct", "iterative"] = "cube"
    cube_side_m: Annotated[float, Field(gt=0, le=0.2)] = 0.01
    cube_points: Annotated[int, Field(ge=2, le=21)] = 11
    round: Literal["each", "best"] = "each"
    deadline_ms: Annotated[float, Field(gt=0, le=60_000)] = 1000.0


class FkRequest(Message):
    """`rpc/fk`: where the bent arm's tool is for commanded angles, coming from `near_rad`."""

    q_rad: Annotated[list[Joints], Field(min_length=1, max_length=1000)]
    payload_kg: Payload = 0.0
    near_rad: Joints | None = None


class PlanRequest(Message):
    """`rpc/plan`: a way from `from_rad` to `to_rad`, or to a goal, round what is in between.

    `seed`: the same seed finds the same way.
    """

    id: Label = ""
    from_rad: Joints
    to_rad: Joints | None = None
    goal: GoalEntry | None = None
    payload_kg: Payload = 0.0
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    deadline_ms: Annotated[float, Field(gt=0, le=60_000)] = 10_000.0

    @model_validator(mode="after")
    def _one_end(self) -> PlanRequest:
        if (self.to_rad is None) == (self.goal is None):
            raise ValueError("give to_rad or goal, one of them")
        return self


class CancelRequest(Message):
    """`rpc/cancel`: the request of this `id` need not be answered any more."""

    id: Annotated[str, Field(min_length=1, max_length=64)]


class IkAnswer(Part):
    """The answer to one goal.

    `verdict`: solved, out_of_reach, outside_limits, not_converged or collision; `text` says it in words. If solved:
    `q_rad` are the commands, `branches_rad` all of them within the limits and free of collision, `tcp_m` where the
    model then has the tool, `predicted_error_m` (and `predicted_turn_rad`) how far that is from the goal, `sd_m` its
    standard deviation (None where the model file has no covariance), `counts` what the board would put out and
    `rounded_error_m` the error that is left then, `direction` the side that each joint has to come from (0: either),
    `detours` joints that would come from the other side. `cube_error_m`: before the polish. Else: `nearest_rad`, the
    command that comes nearest, `nearest_distance_m` away; or, of a collision, the two `bodies` and how far apart they
    would be, `clearance_m` (below zero: inside each other).
    """

    verdict: Literal["solved", "out_of_reach", "outside_limits", "not_converged", "collision"]
    text: str
    q_rad: list[float] | None = None
    branches_rad: list[list[float]] = []
    tcp_m: list[float] | None = None
    predicted_error_m: float | None = None
    predicted_turn_rad: float | None = None
    sd_m: float | None = None
    counts: list[int] | None = None
    rounded_q_rad: list[float] | None = None
    rounded_error_m: float | None = None
    direction: list[int] = []
    detours: list[int] = []
    cube_error_m: float | None = None
    nearest_rad: list[float] | None = None
    nearest_distance_m: float | None = None
    bodies: list[str] = []
    clearance_m: float | None = None
    elapsed_ms: float


class IkReply(Header):
    """All answers, in the order of the goals. `model_sha256`: of the model file in use, empty for the nominal arm."""

    model: str
    model_sha256: str
    left_out: list[str]
    answers: list[IkAnswer]
    elapsed_ms: float


class PlanReply(Header):
    """The way: straight moves through `waypoints_rad`, the start included; empty if there is none, as `text` says.

    Waypoints stand where the way turns and where a joint passes a point of its level-1 table, so that moves which are
    straight in pulses are straight in angles.
    """

    found: bool
    text: str
    waypoints_rad: list[list[float]] = []
    model: str
    model_sha256: str
    elapsed_ms: float


class Place(Part):
    """Where the tool is: position, rows of its rotation matrix, gravity's torque on every joint, standard deviation."""

    tcp_m: list[float]
    rotation: list[list[float]]
    tau_nm: list[float]
    sd_m: float | None


class FkReply(Header):
    """One place for every row of angles."""

    model: str
    model_sha256: str
    left_out: list[str]
    places: list[Place]
    elapsed_ms: float
