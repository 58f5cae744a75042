"""The arm of a campaign, driven through LeRobot: straight slow moves in joint space, watched by its own encoders.

Nothing is known of obstacles here: every pose and the straight way to it has to be free.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from lrm_ident.measuring.campaign.data_file import ArmState
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.rover_arm import APPROACH, last_directions
from lrm_ident.measuring.campaign.run import Clock, Unreachable
from lrm_math.arm.arm import Arm
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
TORQUE = 600
"""Thousandths of a Feetech servo's greatest torque that it may use meanwhile."""
READS = 5
SUFFIX = ".pos"


@dataclass
class LeRobotArm:
    """See `CampaignArm`. `robot`: a connected robot of LeRobot, in degrees; `ask_for_load` as of `RoverArm`.

    Raises `LrmError`: not the arm's joints, or no thermometers.
    """

    robot: Any
    arm: Arm
    clock: Clock
    ask_for_load: Callable[[float], object]
    session: int = 1
    direction: tuple[int, ...] = field(init=False)
    _target: tuple[float, ...] = field(init=False)
    _rest: tuple[float, ...] = field(init=False)

    def __post_init__(self) -> None:
        names = [joint.name or f"joint{i}" for i, joint in enumerate(self.arm.joints, start=1)]
        self.keys = [f"{name}{SUFFIX}" for name in names]
        have = [key for key in self.robot.action_features if key.endswith(SUFFIX)]
        if missing := [key for key in self.keys if key not in have]:
            listed = ", ".join(key.removesuffix(SUFFIX) for key in have)
            what = f"{self.robot.name} has no '{missing[0].removesuffix(SUFFIX)}' of {self.arm.name}"
            raise LrmError(f"{what}; it has {listed}")
        self.motors = [key.removesuffix(SUFFIX) for key in self.keys]
        self.direction = (0,) * self.arm.dof
        self._target = self._rest = self.seen()
        self.temperature()
        self._bound_torque()

    def go(self, pose: PlannedPose) -> ArmState:
        """See `CampaignArm`."""
        outside = [
            i for i, (q, j) in enumerate(zip(pose.q, self.arm.joints, strict=True)) if not j.lower <= q <= j.upper
        ]
        if outside:
            raise Unreachable(f"joint {outside[0] + 1} would leave its limits")
        if pose.approach:
            self._move([self._within(i, q - pose.approach * APPROACH) for i, q in enumerate(pose.q)])
        self._move(pose.q)
        self._rest = self._quiet()
        return ArmState(self._target, self.direction, self.temperature(), self.session)

    def disturbed(self) -> str:
        """See `CampaignArm`."""
        torque = self._read("Torque_Enable")
        limp = [name for name in self.motors if not torque[name]]
        if limp:
            return f"{limp[0]} has no torque"
        off = [abs(a - b) for a, b in zip(self.seen(), self._rest, strict=True)]
        return f"{self.motors[off.index(max(off))]} was moved" if max(off) > MOVED else ""

    def too_warm(self) -> str:
        """See `CampaignArm`."""
        heat = self._read("Present_Temperature")
        hot = next((name for name in self.motors if heat[name] >= HOT_C), None)
        return "" if hot is None else f"{hot} is {heat[hot]:g} °C"

    def cool(self, rest: PlannedPose) -> None:
        """See `CampaignArm`."""
        self._move(rest.q)
        while self.temperature() > COOL_C:
            self.clock.sleep(1.0)

    def load(self, payload: float) -> None:
        """See `CampaignArm`."""
        self.ask_for_load(payload)

    def temperature(self) -> float:
        """Temperature of the hottest servo (degC). Raises `LrmError`: the robot has no thermometers."""
        heat = self._read("Present_Temperature")
        return float(max(heat[name] for name in self.motors))

    def _within(self, joint: int, q: float) -> float:
        return min(max(q, self.arm.joints[joint].lower), self.arm.joints[joint].upper)

    def _move(self, goal: Sequence[float]) -> None:
        """Straight there, each joint in time with the slowest. Raises `LrmError` and holds if one is held up."""
        start = self._target
        far = max(abs(b - a) for a, b in zip(start, goal, strict=True))
        steps = max(1, math.ceil(far / (SPEED * TICK_S)))
        for step in range(1, steps + 1):
            self._send([a + (b - a) * step / steps for a, b in zip(start, goal, strict=True)])
            self.clock.sleep(TICK_S)
            if step % WATCHED == 0:
                self._check_follows()
        self._target = tuple(goal)
        self.direction = last_directions([start, goal], self.direction)

    def _check_follows(self) -> None:
        seen = self.seen()
        behind = [abs(a - b) for a, b in zip(seen, self._target, strict=True)]
        if max(behind) > BEHIND:
            self._send(seen)
            name, off = self.motors[behind.index(max(behind))], math.degrees(max(behind))
            raise LrmError(f"{name} does not follow: {off:.0f} deg behind its command; is it held up? The arm holds")

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
        self.robot.send_action(dict(zip(self.keys, map(math.degrees, q), strict=True)))
        self._target = tuple(q)

    def seen(self) -> tuple[float, ...]:
        """(n,), what the encoders read (rad)."""
        values: Mapping[str, Any] = self._patiently(self.robot.get_observation)
        return tuple(math.radians(float(values[key])) for key in self.keys)

    def _read(self, register: str) -> Mapping[str, Any]:
        bus = getattr(self.robot, "bus", None)
        if bus is None:
            raise LrmError(f"{self.robot.name} has no motor bus whose {register} can be read; measuring needs it")
        return dict(self._patiently(lambda: bus.sync_read(register, self.motors)))

    def _bound_torque(self) -> None:
        """Bounds the torque of servos that can; it is theirs again when they are switched on anew."""
        bus = self.robot.bus
        tables = {name: bus.model_ctrl_table[bus.motors[name].model] for name in self.motors}
        for name, table in tables.items():
            if "Torque_Limit" in table:
                self._patiently(partial(bus.write, "Torque_Limit", name, TORQUE))

    def _patiently(self, ask: Callable[[], Any]) -> Any:
        """Asks again where an answer came too late, and forgets that one. Raises `LrmError`: none comes."""
        for _ in range(READS - 1):
            try:
                return ask()
            except (ConnectionError, RuntimeError):
                self.clock.sleep(GLANCE_S)
                self._forget_late_answers()
        try:
            return ask()
        except (ConnectionError, RuntimeError) as error:
            raise LrmError(f"{self.robot.name} does not answer: {' '.join(str(error).split())}") from None

    def _forget_late_answers(self) -> None:
        """Empties the serial port: LeRobot would take them for answers to what is asked next."""
        port = getattr(getattr(self.robot.bus, "port_handler", None), "ser", None)
        if port is not None:
            port.reset_input_buffer()
