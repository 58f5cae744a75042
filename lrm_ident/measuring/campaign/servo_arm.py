"""The arm of a campaign, driven servo by servo: straight slow moves in joint space, watched by its own encoders.

Nothing is known of obstacles here: every pose and the straight way to it has to be free.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

import numpy as np

from lrm_ident.measuring.campaign.data_file import ArmState
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.rover_arm import APPROACH, MOVES_BEGIN, check_begins, last_directions
from lrm_ident.measuring.campaign.run import Clock, Unreachable
from lrm_ident.measuring.excitation.sequence import MoveSequence, PlayedRow
from lrm_ident.measuring.servo_bus.torque_on import TORQUE
from lrm_math.arm.arm import Arm
from lrm_math.arm.servo_settings import ServoSettings
from lrm_math.arm.standing import require_standing
from lrm_math.errors import LrmError

SPEED = math.radians(30.0)
"""rad/s, of the fastest joint."""
TICK_S, WATCHED = 1.0 / 30.0, 6
"""s between commands; every so many of them the encoders are read."""
BEHIND, MOVED = math.radians(25.0), math.radians(1.0)
"""rad: a joint that is further behind its command is held up; one that stands elsewhere by more was moved."""
QUIET, LONGEST_S, GLANCE_S = math.radians(0.3), 5.0, 0.2
"""rad: an arm that moves less in a glance (s) stands; s that it may take to."""
HOT_C, COOL_C = 55.0, 45.0
"""Servos switch off at 70 °C."""
READS = 5
BEGINS = math.radians(30.0)
"""rad by which a joint may stand beside the first pose of a sequence: nobody checks the straight way there."""
LOOKED = 150
"""Commands of a sequence between two looks at the temperature."""
FASTER = 1.001
"""Times the allowed speed that rounded commands may seem to be."""
Answer = TypeVar("Answer")


class Servos(Protocol):
    """Servos of an arm, one for each of its `joints`, in their order. A method that asks them raises `OSError` or
    `RuntimeError` where an answer did not come, or the line is gone."""

    @property
    def name(self) -> str:
        """Name of what drives them, for messages."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Their names."""

    def angles(self) -> tuple[float, ...]:
        """(n,), what the encoders read (rad)."""

    @property
    def step(self) -> float:
        """Angle (rad) of one count, whose multiples can be commanded; 0 if any angle can."""

    def beyond_limits(self, q: Sequence[float]) -> str:
        """The first of angles (n,), rad, that is beyond its servo's own limits, in words; empty if none is."""

    def command(self, q: Sequence[float]) -> None:
        """Commands angles (n,), rad."""

    def powered(self) -> Mapping[str, bool]:
        """Whether each holds torque."""

    def temperature(self) -> Mapping[str, float]:
        """°C of each."""

    def settings(self) -> ServoSettings:
        """Settings of each that belong to what is measured with them; of those whose registers can be read."""

    def bound_torque(self, share: float) -> None:
        """Bounds the torque of those that can, to a share of their greatest, until they are switched on anew."""

    def forget_late_answers(self) -> None:
        """Drops what has come, so that it is not taken for answers to what is asked next."""


@dataclass
class ServoArm:
    """See `CampaignArm`. `speed`: rad/s of the fastest joint; `change_payload` as of `RoverArm`. Raises `LrmError`."""

    servos: Servos
    arm: Arm
    clock: Clock
    change_payload: Callable[[float], object]
    speed: float = SPEED
    session: int = 1
    settle_s: float | None = None
    direction: tuple[int, ...] = field(init=False)
    _target: tuple[float, ...] = field(init=False)
    _rest: tuple[float, ...] = field(init=False)

    def __post_init__(self) -> None:
        self.direction = (0,) * self.arm.dof
        self._target = self._rest = self.seen()
        require_standing(self.arm, np.array(self._target))
        self.temperature()
        self._with_retries(lambda: self.servos.bound_torque(TORQUE))

    def go(self, pose: PlannedPose) -> ArmState:
        """See `CampaignArm`."""
        outside = [
            i for i, (q, j) in enumerate(zip(pose.q, self.arm.joints, strict=True)) if not j.lower <= q <= j.upper
        ]
        if outside:
            raise Unreachable(f"joint {outside[0] + 1} would leave its limits")
        sides = pose.approach or (0,) * self.arm.dof
        beside = [self._within(i, q - side * APPROACH) for i, (q, side) in enumerate(zip(pose.q, sides, strict=True))]
        if why := self.servos.beyond_limits(pose.q) or self.servos.beyond_limits(beside):
            raise Unreachable(why)
        if any(pose.approach):
            self._move(beside)
        self._move(pose.q)
        self._rest = self._quiet()
        return ArmState(self._target, self.direction, self.temperature(), self.session)

    @property
    def names(self) -> list[str]:
        """Names of the joints."""
        return list(self.servos.joints)

    def check_moves(self, moves: MoveSequence) -> None:
        """Raises `LrmError`: they begin too far away, are faster than `speed`, or beyond the servos' own limits."""
        check_begins(self.names, self._target, moves, BEGINS)
        if moves.fastest.max() > FASTER * self.speed:
            joint = int(np.argmax(moves.fastest))
            what = f"the moves turn {self.servos.joints[joint]} at {math.degrees(moves.fastest[joint]):.1f} deg/s"
            raise LrmError(f"{what}; --speed allows {math.degrees(self.speed):g} deg/s")
        for q in moves.knots.q.tolist():
            if why := self.servos.beyond_limits(q):
                raise LrmError(why)

    def follow(self, moves: MoveSequence, keep: Callable[[PlayedRow], object]) -> None:
        """Along a sequence of commands from its first, where it stands, never faster than it; `keep` gets every row.

        Raises `LrmError` where a joint is held up, lost its torque, or is too warm; see `check_moves`.
        """
        self.check_moves(moves)
        check_begins(self.names, self._target, moves, MOVES_BEGIN)
        begun, reading, last = self.clock.now(), 0.0, self._target
        for number, (t, q) in enumerate(zip((moves.t - moves.t[0]).tolist(), moves.q.tolist(), strict=True)):
            self.clock.sleep(begun + t - reading - self.clock.now())
            asked = self.clock.now()
            seen = self.seen()
            reading = min(reading or math.inf, self.clock.now() - asked)
            self.clock.sleep(begun + t - self.clock.now())
            begun = max(begun, self.clock.now() - t)  # what was late is not made up for: that would be faster
            self._send(q)
            keep(PlayedRow(self.clock.now(), self._target, seen))
            if number % WATCHED == 0:
                self._check_follows()
            if number % LOOKED == 0 and (why := self.too_warm()):
                raise LrmError(f"{why}; the arm holds")
        self.direction = last_directions([last, self._target], self.direction)

    def settings(self) -> ServoSettings:
        """Settings of the servos."""
        return self._with_retries(self.servos.settings)

    def disturbed(self) -> str:
        """See `CampaignArm`."""
        if limp := self._limp():
            return f"{limp[0]} has no torque"
        off = [abs(a - b) for a, b in zip(self.seen(), self._rest, strict=True)]
        return f"{self.servos.joints[off.index(max(off))]} was moved" if max(off) > MOVED else ""

    def too_warm(self) -> str:
        """See `CampaignArm`."""
        heat = self._with_retries(self.servos.temperature)
        hot = next((name for name, degrees in heat.items() if degrees >= HOT_C), None)
        return "" if hot is None else f"{hot} is {heat[hot]:g} °C"

    def cool(self, rest: PlannedPose) -> None:
        """See `CampaignArm`."""
        self._move(rest.q)
        while self.temperature() > COOL_C:
            self.clock.sleep(1.0)

    def temperature(self) -> float:
        """Temperature of the hottest servo (degC). Raises `LrmError`: the robot has no thermometers."""
        return float(max(self._with_retries(self.servos.temperature).values()))

    def rounded(self, q: Sequence[float]) -> tuple[float, ...]:
        """(n,), the nearest angles (rad) that can be commanded; within the limits for angles (n,) that are."""
        return tuple(self._rounded(i, angle) for i, angle in enumerate(q))

    def _rounded(self, joint: int, angle: float) -> float:
        step, low, high = self.servos.step, self.arm.joints[joint].lower, self.arm.joints[joint].upper
        if not step:
            return angle
        nearest = round(angle / step) * step
        if low <= angle <= high and not low <= nearest <= high:
            return nearest + math.copysign(step, angle - nearest)
        return nearest

    def _within(self, joint: int, q: float) -> float:
        return min(max(q, self.arm.joints[joint].lower), self.arm.joints[joint].upper)

    def _move(self, goal: Sequence[float]) -> None:
        """Straight there, each joint in time with the slowest. Raises `LrmError` and holds if one is held up."""
        start = self._target
        far = max(abs(b - a) for a, b in zip(start, goal, strict=True))
        steps = max(1, math.ceil(far / (self.speed * TICK_S)))
        for step in range(1, steps + 1):
            share, due = step / steps, self.clock.now() + TICK_S
            self._send([(1.0 - share) * a + share * b for a, b in zip(start, goal, strict=True)])
            self.clock.sleep(due - self.clock.now())
            if step % WATCHED == 0:
                self._check_follows()
        self.direction = last_directions([start, self._target], self.direction)

    def _check_torque(self) -> None:
        """Raises `LrmError` if a joint has lost its torque: it has fallen, and nothing may pull it back from there.

        Before every command: a Feetech servo that gets a goal switches its torque on by itself, and unbounded after its
        supply was off (huggingface/lerobot issue 3585).
        """
        if limp := self._limp():
            raise LrmError(f"{', '.join(limp)} lost torque: was the supply off? Look where the arm stands, start again")

    def _limp(self) -> list[str]:
        return [name for name, powered in self._with_retries(self.servos.powered).items() if not powered]

    def _check_follows(self) -> None:
        """Raises `LrmError` and holds if a joint is far behind its command, and still is a glance later."""
        seen, behind = self._behind()
        if max(behind) > BEHIND:
            self.clock.sleep(GLANCE_S)
            seen, behind = self._behind()
        if max(behind) > BEHIND:
            self._send(seen)
            name, off = self.servos.joints[behind.index(max(behind))], math.degrees(max(behind))
            raise LrmError(f"{name} does not follow: {off:.0f} deg behind its command; is it held up? The arm holds")

    def _behind(self) -> tuple[tuple[float, ...], list[float]]:
        """(n,) each, rad: what the encoders read, and how far that is from the command."""
        seen = self.seen()
        return seen, [abs(a - b) for a, b in zip(seen, self._target, strict=True)]

    def _quiet(self) -> tuple[float, ...]:
        """Angles (rad) that the encoders read once nothing moves any more."""
        seen = self.seen()
        for _ in range(round(LONGEST_S / GLANCE_S)):
            self.clock.sleep(GLANCE_S)
            before, seen = seen, self.seen()
            if max(abs(a - b) for a, b in zip(before, seen, strict=True)) < QUIET:
                break
        return seen

    def _send(self, q: Sequence[float]) -> None:
        """Commands angles (n,), rad, where all joints have torque. Raises `LrmError`: see `_check_torque`."""
        target = self.rounded(q)

        def order() -> None:
            """Also before it is repeated: the supply may have been off meanwhile."""
            self._check_torque()
            self.servos.command(target)

        self._with_retries(order)
        self._target = target

    def commanded(self) -> tuple[float, ...]:
        """See `CampaignArm`."""
        return self._target

    def seen(self) -> tuple[float, ...]:
        """(n,), what the encoders read (rad)."""
        return self._with_retries(self.servos.angles)

    def _with_retries(self, request: Callable[[], Answer]) -> Answer:
        """Sends a request again where an answer came too late, and forgets that one. Raises `LrmError`: none comes."""
        why = ""
        for attempt in range(READS):
            try:
                if attempt:
                    self.clock.sleep(GLANCE_S)
                    self.servos.forget_late_answers()
                return request()
            except (OSError, RuntimeError) as error:
                why = " ".join(str(error).split())
        raise LrmError(f"{self.servos.name} does not answer: {why}")
