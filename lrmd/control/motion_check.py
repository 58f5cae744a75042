"""Check of a commanded motion: allowed by the collision guard all along, and no more load on a hot servo."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lrm_math.arrays import ORIGIN, Vector3
from lrm_math.collision.contact import Contact
from lrmd.config import Config
from lrmd.control.ramp_orders import Leg, Pulses, angles, overlaid
from lrmd.errors import RequestError
from lrmd.ramp.stepping import Move
from lrmd.safety.collision_guard import ClearanceViolation, CollisionGuard, Guard
from lrmd.safety.contact_force import ContactRules
from lrmd.safety.stability import TipOverViolation
from lrmd.safety.thermal_model import ThermalMonitor, Torques

BEARABLE_S = 60.0
"""s: a load with which a servo would be too hot sooner is not one that the arm carries."""


class MotionCheck:
    """`guard` checks clearances, or None; `torques` gives the joint torques of a pose, `thermal` the temperatures.

    `touched`: pairs of bodies that requests were permitted to bring nearer than the margin, since they did.
    `load_at`: the centre of the load (m), which `guard` knows, too.
    """

    def __init__(self, config: Config, torques: Torques, guard: Guard | None, thermal: ThermalMonitor) -> None:
        self._config, self._thermal = config, thermal
        self.torques, self.guard = torques, guard
        self.touched: frozenset[frozenset[str]] = frozenset()
        self.load_at: Vector3 = ORIGIN

    def check(self, start: Pulses, legs: Sequence[Leg], payload: float, contacts: Sequence[Contact] = ()) -> None:
        """Raises `RequestError` for legs from pulses (ns) that collide, or end with more load on a hot servo than now.

        Passes on any other `LrmError` of the guard.
        """
        self.check_clearance(start, legs, payload, contacts)
        torques_now, here = self.servo_torques(start, payload), start
        for leg in legs:
            here = overlaid(here, leg.target)
            self._thermal.check_load(torques_now, self.servo_torques(here, payload))

    def check_clearance(
        self, start: Pulses, legs: Sequence[Leg], payload: float, contacts: Sequence[Contact] = ()
    ) -> None:
        """Passes the ramp's path along legs from pulses (ns) to the guard, with `contacts` that the request permits.
        Raises as `check`.

        Each segment between two corners is straight in joint space, as the guard requires.
        """
        path, numbers, here = [self._joints(start)], [], start
        for number, leg in enumerate(legs, start=1):
            ramp = replace(leg, impulses=(), waits=()).move(here)  # a shaped move takes the same way
            for there in (self._joints(ramp.at(k)) for k in corners(self._config, ramp)):
                if there != path[-1]:
                    path.append(there)
                    numbers.append(number)
            here = ramp.at(ramp.length)
        if not numbers or self.guard is None:
            return
        try:
            self.guard(path, payload, ContactRules(tuple(contacts), self.touched))
        except ClearanceViolation as error:
            raise _collision(error, numbers[error.move]) from None
        except TipOverViolation as error:
            raise _tipping(error, numbers[error.move]) from None

    def check_bearable(self, pulses: Pulses, payload: float, guard: Guard | None, centre: Vector3) -> None:
        """Raises `RequestError` where a servo would soon be too hot at pulses (ns) with a payload (kg) and its centre
        (m), or where `guard`, which knows that centre, finds no elastic equilibrium."""
        self._thermal.check_bearable(self._torques(pulses, payload, centre), BEARABLE_S)
        if isinstance(guard, CollisionGuard) and not guard.settles(np.array(self._joints(pulses)), payload):
            text = f"with {payload * 1e3:.0f} g the arm would not come to rest where it stands: no load for this arm"
            raise RequestError("too_heavy", text)

    def touch(self, contacts: Sequence[Contact]) -> None:
        """Notes the pairs that a motion which begins now may bring nearer than the margin."""
        self.touched |= {contact.permit.pair for contact in contacts}

    def servo_torques(self, pulses: Pulses, payload: float) -> tuple[float, ...]:
        """Gravity torque (N m) on every servo for pulses (ns) and a payload (kg); 0 for servos that are no joint."""
        return self._torques(pulses, payload, self.load_at)

    def _torques(self, pulses: Pulses, payload: float, centre: Vector3) -> tuple[float, ...]:
        tau = tuple(float(t) for t in self.torques(self._joints(pulses), payload, centre))
        return tau + (0.0,) * (len(self._config.servos) - len(tau))

    def _joints(self, pulses: Pulses) -> list[float]:
        return angles(self._config, pulses)[: self._config.dof]


def _collision(error: ClearanceViolation, waypoint: int) -> RequestError:
    return RequestError(
        "collision", f"waypoint {waypoint}: {error}", waypoint=waypoint, bodies=[error.first, error.second],
        distance_m=error.distance, fraction=error.fraction,
    )  # fmt: skip


def _tipping(error: TipOverViolation, waypoint: int) -> RequestError:
    return RequestError(
        "tip_over",
        f"waypoint {waypoint}: {error}",
        waypoint=waypoint,
        tip_over_rad=error.angle,
        fraction=error.fraction,
    )


def corners(config: Config, ramp: Move) -> list[int]:
    """Ticks at which the path through joint space bends: a joint stops, or passes a point of its level-1 table.

    Between them all joints turn in proportion, so each segment is straight in angles, too.
    """
    corner_poses = set()
    for servo, start, distance, ticks in zip(
        config.servos[: config.dof], ramp.start, ramp.distance, ramp.ticks, strict=False
    ):
        if distance:
            passed = [(round(p * 1e9) - start) * ticks / distance for p in servo.table.pulse]
            corner_poses |= {
                ticks,
                *(round_k(k) for k in passed if 0 < k < ticks for round_k in (math.floor, math.ceil)),
            }
    return sorted(corner_poses)
