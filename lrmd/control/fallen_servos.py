"""Servos without pulses that do not stand where they were commanded: their pulses ended in motion or under load.

RC servos have no brake. The friction of their gears holds gravity's torque up to `safety.unpowered_nm`. With more of it
the arm falls, and carries the joints with it that have no pulses either. Where it comes to lie is not known. That holds
later, too: a joint that stayed where its pulses ended falls once the others, a load or the direction of gravity have
changed what it bears.
"""

from __future__ import annotations

from lrmd.config import Config
from lrmd.control.motion_check import MotionCheck
from lrmd.control.ramp_orders import Pulses
from lrmd.persistence.state_file import StoredState
from lrmd.ramp.shared_memory import RampReport


class FallenServos:
    """`bits`: those servos now. What was stored is of servos that had no pulses since."""

    def __init__(self, config: Config, check: MotionCheck, stored: StoredState | None) -> None:
        self._config, self._check = config, check
        self._all = (1 << len(config.servos)) - 1
        fallen = stored.fallen if stored else []
        self.bits = self._all if fallen is None else sum(1 << i for i, n in enumerate(config.names) if n in fallen)
        self._stored = [stored.pulse_ns.get(name, 0) if stored else 0 for name in config.names]
        self._bears: tuple[object, ...] = ()

    def follow(self, before: RampReport, now: RampReport, payload: float) -> None:
        """Compares two reports of the ramp, one after the other; `payload`: kg."""
        ended, n = before.outputs & ~now.outputs, len(self._config.servos)
        moved = before.moving or before.position[:n] != now.position[:n]
        if ended and (moved or self._loaded(ended, before, payload)):
            self.bits = self._all
        if self._bears_more(now, payload) and self._loaded(self._resting(now), now, payload):
            self.bits = self._all
        self.bits &= ~now.outputs

    def _resting(self, now: RampReport) -> int:
        """Joints (bits) without pulses that still stand where they were."""
        return ~(self.bits | now.outputs) & ((1 << self._config.dof) - 1)

    def _bears_more(self, now: RampReport, payload: float) -> bool:
        """Whether joints without pulses may bear something else than when this was asked last."""
        if not self._resting(now):
            self._bears = ()
            return False
        before, self._bears = self._bears, (self._pulses(now), payload, self._check.torques)
        return before not in ((), self._bears)

    def _pulses(self, report: RampReport) -> Pulses:
        """Last pulse (ns) of every servo, the stored one of those that had none since the start."""
        return tuple(position or other for position, other in zip(report.position, self._stored, strict=False))

    def names_if_all_ended(self, report: RampReport, payload: float) -> list[str]:
        """Names of those servos if the pulses ended now, as they do when the daemon is killed."""
        falls = report.moving or self._loaded(report.outputs, report, payload)
        return self.names(self._all if falls else self.bits)

    def names(self, bits: int) -> list[str]:
        """Names of servos (bits)."""
        return [name for i, name in enumerate(self._config.names) if bits >> i & 1]

    def _loaded(self, servos: int, report: RampReport, payload: float) -> bool:
        """Whether one of some servos (bits) bears more than its friction does."""
        torques = self._check.servo_torques(self._pulses(report), payload) if servos else ()
        return any(servos >> i & 1 and abs(tau) > self._config.unpowered for i, tau in enumerate(torques))
