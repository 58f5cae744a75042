"""The arm of a campaign or a verification, driven by its daemon: planned ways, pulses in whole counts, cooling.

The daemon says that the arm stands: the same before and after a rest, nobody has moved it or let it fall. Commands for
goals of the tip come from its inverse kinematics.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Self, TypeVar

import numpy as np

from lrm_ident.data.rigid_motion import quaternions
from lrm_ident.measuring.campaign.data_file import ArmState
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.run import Clock, Unreachable
from lrm_ident.measuring.excitation.sequence import MoveSequence, PlayedRow
from lrm_ident.measuring.verification.goal_commands import NOMINAL, GoalCommand, of_a_measurement
from lrm_math.arm.servo_table import ServoTable
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.goal import Goal
from lrmd.client import (
    LEASE_LOST,
    GoalEntry,
    IkRequest,
    InfoState,
    MotionInterrupted,
    PlanRequest,
    RequestRefused,
    Rover,
)

STILL = ("armed", "holding")
"""Modes of an arm that stands with pulses on."""
REACHED = 1e-5
"""rad; commanded pulses are whole ns, 2e-6 rad."""
APPROACH = math.radians(3.0)
"""rad: how far on the stated side a joint stands before it arrives from there."""
COOLED_BY = 10.0
"""K that the servo has to cool before the campaign goes on."""
LOOK = 1.0
"""s between two looks at a temperature."""
PLAN_MS = 20_000.0
MOVED = 1e-9
"""rad; a joint that turns less has not moved."""
ATTEMPTS, LEASE_BACK_S = 5, 1.0
"""Attempts at a motion whose lease expires, and s until it is back: a busy computer, a slow network."""
OVER = ("lease", "wrong_mode", "name_taken", "link", "not_armed", "overtaken")
"""Codes of refusals that end a campaign: the arm is somebody else's, not armed any more, or somebody stopped it."""
DEADLINE_MS = 10_000.0
STARTING, STARTING_S = 60, 0.5
"""Times that the ik process is asked anew while it is being started, and s between them."""
T = TypeVar("T")
MOVES_BEGIN = math.radians(1.0)
"""rad by which a joint may stand beside the first of a sequence of commands when that begins."""
FASTER, SAME_SHARE, STANDS, MOST_WAYPOINTS = 1.05, 0.05, 1e-3, 1000
"""Times the ramp's rate that a sequence may seem to be; shares of it that differ by less are one motion; one that is
none; waypoints of a request."""


@dataclass(frozen=True)
class ControlState:
    """The daemon's start and the lease of the client that it says so to; its mode, why, since when (monotonic ns).

    `q`: commanded angles (rad), `on`: whether there are pulses, of every servo.
    """

    boot_id: str
    lease: str
    mode: str
    why: str
    since: int
    q: tuple[float, ...]
    on: tuple[bool, ...]

    @classmethod
    def of(cls, rover: Rover) -> Self:
        """The present one. Raises what a query raises, and `RequestRefused` if the lease is another client's."""
        lease, mode, joints = rover.renew(), rover.mode(), rover.joints()
        return cls(mode.boot_id, lease, mode.mode, mode.why, mode.since_mono_ns, tuple(joints.q_rad), tuple(joints.on))

    def holds(self, goal: Sequence[float]) -> bool:
        """Whether the arm stands at angles of its joints (rad)."""
        there = all(abs(a - b) < REACHED for a, b in zip(self.q, goal, strict=False))
        return self.mode in STILL and there and all(self.on[: len(goal)])

    def differences_to(self, current: ControlState) -> str:
        """Differences from then, in words; empty if everything is."""
        changes = {
            "the daemon was restarted": self.boot_id != current.boot_id,
            "the lease was acquired anew": self.lease != current.lease,
            f"the arm is {current.mode} ({current.why})": (self.mode, self.since) != (current.mode, current.since),
            "other angles are commanded": self.q != current.q,
            "other servos have pulses": self.on != current.on,
        }
        return "; ".join(words for words, changed in changes.items() if changed)


@dataclass
class RoverArm:
    """See `CampaignArm`. `change_payload`: has somebody change it (kg). `session`: of the servos' power.

    `stops`: how often the arm had been stopped when the campaign began. After another stop, at a rest too, it moves
    nothing any more.
    """

    rover: Rover
    clock: Clock
    change_payload: Callable[[float], object]
    session: int
    info: InfoState = field(init=False)
    direction: tuple[int, ...] = field(init=False)
    at_pose: ControlState | None = field(init=False, default=None)
    stops: int = field(init=False)

    def __post_init__(self) -> None:
        self.info = self.rover.info()
        self.direction = (0,) * self.info.joints
        mode = self.rover.mode()
        self.stops = mode.stops
        if mode.mode not in STILL:
            raise LrmError(f"{self.info.robot} is {mode.mode} ({mode.why}); arm it first: lrm arm --q ...")

    @property
    def settle_s(self) -> float | None:
        """See `CampaignArm`."""
        return self.rover.settle_95_s

    @property
    def names(self) -> list[str]:
        """Names of the joints."""
        return self.info.names[: self.info.joints]

    def go(self, pose: PlannedPose) -> ArmState:
        """See `CampaignArm`."""
        goal = self.rounded(pose.q)
        if any(pose.approach):
            beside = [q - side * APPROACH for q, side in zip(goal, pose.approach, strict=True)]
            self._move(self._within(beside), pose.payload)
        self._move(goal, pose.payload)
        temperature = max(self.rover.thermal().temperature_c)
        self._stands(goal)
        return ArmState(goal, self.direction, temperature, self.session)

    def _stands(self, goal: Sequence[float]) -> None:
        """Notes the state after a motion. Raises `MotionInterrupted`: the arm does not stand at its goal (rad)."""
        self.at_pose = self._control_state()
        if self.at_pose is not None and not self.at_pose.holds(goal):
            raise MotionInterrupted(self.at_pose.mode, self.at_pose.why)

    def check_moves(self, moves: MoveSequence) -> None:
        """Raises `LrmError`: faster than the ramp, or beyond the daemon's limits."""
        lowest, highest = moves.q.min(axis=0).tolist(), moves.q.max(axis=0).tolist()
        limits = self.info.limits_rad[: self.info.joints]
        for name, least, most, (low, high) in zip(self.names, lowest, highest, limits, strict=True):
            if least < low or most > high:
                turns = f"the moves turn {name} from {math.degrees(least):.1f} to {math.degrees(most):.1f} deg"
                allowed = f"{math.degrees(low):.1f} to {math.degrees(high):.1f} deg"
                raise LrmError(f"{turns}; {self.info.robot} allows {allowed}")
        if (most := self._shares(moves).max()) > FASTER:
            raise LrmError(f"the moves are {most:.2f} times as fast as the ramp of {self.info.robot}")

    def _shares(self, moves: MoveSequence) -> Array:
        """(K − 1,), of the ramp's rate between knots."""
        rates = np.array(self.info.rate_rad_per_s[: self.info.joints])
        ways = np.abs(np.diff(moves.knots.q, axis=0))
        return np.asarray((ways / rates).max(axis=1) / np.diff(moves.knots.t))

    def follow(self, moves: MoveSequence, keep: Callable[[PlayedRow], object]) -> None:
        """Along a sequence of commands from its first, piece by piece, each at its share of the ramp's rate.

        The daemon keeps limits, rate and distances. `keep` gets nothing: there are no encoders. Raises `LrmError`: what
        the daemon refuses, or the arm did not stand where a piece left it until the next; see `check_moves`.
        """
        del keep
        self.check_moves(moves)
        check_begins(self.names, self.commanded(), moves, MOVES_BEGIN)
        knots, shares = moves.knots, [*self._shares(moves).tolist(), 0.0]
        leg: list[dict[str, float]] = []
        for number, (share, after) in enumerate(pairwise(shares)):
            if share < STANDS:
                self.clock.sleep(float(knots.t[number + 1] - knots.t[number]))
                self._check_undisturbed()
                continue
            leg.append(dict(zip(self.names, knots.q[number + 1].tolist(), strict=True)))
            if abs(after - share) > SAME_SHARE * share or len(leg) == MOST_WAYPOINTS:
                self.rover.move(*leg, speed=min(share, 1.0), stops=self.stops)
                self._stands([*leg[-1].values()])
                if self.at_pose is None:  # the lease had expired: who knows what happened meanwhile
                    self._check_undisturbed()
                leg = []
        self._check_undisturbed()
        self.direction = last_directions(knots.q.tolist(), self.direction)

    def _check_undisturbed(self) -> None:
        if why := self.disturbed():
            raise LrmError(f"the moves ended: {why}")

    def commanded(self) -> tuple[float, ...]:
        """See `CampaignArm`."""
        return tuple(self.rover.commanded_q())

    def disturbed(self) -> str:
        """See `CampaignArm`."""
        try:
            current = ControlState.of(self.rover)
        except LrmError as error:
            return str(error)
        return "the lease had expired" if self.at_pose is None else self.at_pose.differences_to(current)

    def _control_state(self) -> ControlState | None:
        """None while the lease has expired: then nobody knows what happens until it is there again."""
        try:
            return ControlState.of(self.rover)
        except RequestRefused as error:
            if error.code != "lease":
                raise
            return None

    def too_warm(self) -> str:
        """See `CampaignArm`."""
        heat = self.rover.thermal()
        return next((f"{n} is {level}" for n, level in zip(heat.names, heat.level, strict=True) if level != "cool"), "")

    def cool(self, rest: PlannedPose) -> None:
        """See `CampaignArm`."""
        wanted = max(self.rover.thermal().temperature_c) - COOLED_BY
        self._move(self.rounded(rest.q), rest.payload)
        while self.too_warm() or max(self.rover.thermal().temperature_c) > wanted:
            self.clock.sleep(LOOK)

    def rounded(self, q: Sequence[float]) -> tuple[float, ...]:
        """Angles (rad) of the nearest pulses that the board can put out: whole counts, within the limits."""
        return tuple(self._rounded(i, angle) for i, angle in enumerate(q))

    def _rounded(self, joint: int, angle: float) -> float:
        table = ServoTable(
            tuple(self.info.tables_rad[joint]), tuple(pulse * 1e-6 for pulse in self.info.tables_us[joint])
        )
        count = self.info.count_us * 1e-6
        low, high = self.info.limits_rad[joint]
        nearest = round(float(table.pulse_of(angle)) / count)
        angles = [float(table.angle_of(counts * count)) for counts in (nearest - 1, nearest, nearest + 1)]
        allowed = [angle_allowed for angle_allowed in angles if low <= angle_allowed <= high] or [angle]
        return min(allowed, key=lambda angle_allowed: abs(angle_allowed - angle))

    def _within(self, q: Sequence[float]) -> tuple[float, ...]:
        limits = self.info.limits_rad[: self.info.joints]
        return tuple(min(max(angle, low), high) for angle, (low, high) in zip(q, limits, strict=True))

    def _move(self, goal: Sequence[float], payload: float) -> None:
        """Moves on planned ways, from where an expired lease stopped it. Raises `Unreachable`, or what ends all."""
        for attempts_left in reversed(range(ATTEMPTS)):
            try:
                self._try_to_move(goal, payload)
                break
            except (MotionInterrupted, RequestRefused) as error:
                expired = error.why == LEASE_LOST if isinstance(error, MotionInterrupted) else error.code == "lease"
                if not expired or not attempts_left:
                    raise
                self.clock.sleep(LEASE_BACK_S)
                mode = self.rover.mode()
                if mode.mode == "holding" and mode.why != LEASE_LOST:  # somebody has stopped the arm meanwhile
                    raise MotionInterrupted(mode.mode, mode.why) from None

    def _try_to_move(self, goal: Sequence[float], payload: float) -> None:
        here = self.rover.commanded_q()
        if max(abs(a - b) for a, b in zip(here, goal, strict=True)) < MOVED:
            return
        request = PlanRequest(from_rad=here, to_rad=list(goal), payload_kg=payload, deadline_ms=PLAN_MS)
        try:
            plan = when_started(lambda: self.rover.plan(request), self.clock.sleep)
            if not plan.found:
                raise Unreachable(f"no way: {plan.text}")
            way = plan.waypoints_rad[1:]
            waypoints = [dict(zip(self.names, q, strict=True)) for q in way]
            self.rover.move(*waypoints, payload_kg=payload, stops=self.stops)
        except RequestRefused as error:
            if error.code in OVER:
                raise
            raise Unreachable(str(error)) from None
        self.direction = last_directions(plan.waypoints_rad, self.direction)


def when_started(ask: Callable[[], T], sleep: Callable[[float], object] = time.sleep) -> T:
    """A reply of the ik process, which is waited for while that is being started. Raises `RequestRefused`."""
    for _ in range(STARTING):
        try:
            return ask()
        except RequestRefused as error:
            if error.code != "busy" or not error.retryable:
                raise
        sleep(STARTING_S)
    return ask()


def check_begins(names: Sequence[str], here: Sequence[float], moves: MoveSequence, bound: float) -> None:
    """Raises `LrmError`: a joint stands further (rad) from the first of a sequence of commands than a bound."""
    off = np.abs(moves.q[0] - np.array(here))
    if not off.max() <= bound:
        worst = int(np.argmax(off))
        where = f"{names[worst]} stands at {math.degrees(here[worst]):.1f} deg"
        begin = f"the moves begin at {math.degrees(moves.q[0, worst]):.1f} deg"
        raise LrmError(f"{where}, {begin}; bring it within {math.degrees(bound):g} deg first")


def last_directions(way: Sequence[Sequence[float]], before: Sequence[int]) -> tuple[int, ...]:
    """Sign of the last move of each joint on a way of angles; as `before` for a joint that did not move."""
    directions = list(before)
    for here, there in pairwise(way):
        for joint, (a, b) in enumerate(zip(here, there, strict=True)):
            if abs(b - a) > MOVED:
                directions[joint] = 1 if b > a else -1
    return tuple(directions)


def _entry(goal: Goal) -> GoalEntry:
    """A goal as the daemon takes it."""
    if goal.rotation is None:
        return GoalEntry(position_m=list(goal.position))
    w, x, y, z = quaternions(np.array(goal.rotation)[None])[0].tolist()
    return GoalEntry(position_m=list(goal.position), quaternion_xyzw=[x, y, z, w])


@dataclass(frozen=True)
class DaemonSolver:
    """See `GoalSolver`: with the model that a daemon uses."""

    rover: Rover
    model: str
    model_sha256: str

    @classmethod
    def of(cls, rover: Rover) -> DaemonSolver:
        """The solver of a daemon."""
        info = rover.info()
        return cls(rover, info.model or NOMINAL, info.model_sha256)

    def solve(self, goal: Goal, near: Sequence[float], payload: float) -> GoalCommand | str:
        """See `GoalSolver`."""
        request = IkRequest(
            goals=[_entry(goal)],
            near_rad=list(near),
            payload_kg=payload,
            round="best",
            method="direct",
            deadline_ms=DEADLINE_MS,
        )
        reply = when_started(lambda: self.rover.ik(request))
        answer = reply.answers[0]
        if answer.rounded_q_rad is None:
            return f"{answer.verdict}: {answer.text}"
        sd = of_a_measurement(answer.sd_m, reply.residual_m)
        return GoalCommand(tuple(answer.rounded_q_rad), answer.rounded_error_m or 0.0, sd)
