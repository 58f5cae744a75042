"""Memory of the driven arm: states of creep, heat and slip, integrated from what it was commanded.

Theory of operation: the API process tells where the joints were last sent (`ArmKnowledge`); the ik process looks at it
between two goals and at least every `IDLE_S`. A stand is integrated when the arm leaves it; while it moves, each look
is a short stand where it has come to. An arm that has just got power rested before, or bore its load where it stands
(`when_powered`). Where nothing is known of the moves so far otherwise - another model, another start of the daemon -
the memory is that of the model's session on average. Its uncertainty stands in the answers until it has faded.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lrm_math.arrays import Array
from lrm_math.kinematics.known import Known, MemoryState
from lrm_math.kinematics.motion import STILL
from lrmd.config import SECOND
from lrmd.ik.service import IkService

FRESH_S = 10.0
"""Time since the servos got power within which the arm has hardly moved, and was not loaded for long."""


class ArmMemory:
    """Follows one arm. Times are monotonic ns."""

    def __init__(self) -> None:
        self._model = ""
        self._remembered: MemoryState | None = None
        self._q: Array = np.zeros(0)
        self._payload = 0.0
        self._since = self._seen = 0

    def follow(self, service: IkService, known: Known, payload: float, now: int) -> None:
        """Takes over where the arm stands, with a payload (kg) that it is known to carry."""
        begun = service.nothing_known if known.motion is not None else None
        if known.motion is None or begun is None:
            self._remembered = None
            return
        q = known.motion.q
        if self._remembered is None or self._model != service.deployed.sha256:
            fresh = known.running is not None and known.running < FRESH_S
            begun = service.when_powered(q, payload) if fresh else begun
            self._model, self._remembered = service.deployed.sha256, begun
            self._since = now
        elif (moved := bool((np.abs(q - self._q) > STILL).any())) or payload != self._payload:
            self._stood(service, self._q, self._seen)
            if moved:
                self._stood(service, q, now, self._q)
        self._q, self._payload, self._seen = q, payload, now

    def stood(self, service: IkService, now: int) -> None:
        """Integrates the stand so far, as before its service changes."""
        if self._remembered is not None:
            self._stood(service, self._q, now)
            self._seen = now

    def _stood(self, service: IkService, q: Array, until: int, start: Array | None = None) -> None:
        self._remembered = self._after(service, q, until, start)
        self._since = until

    def _after(self, service: IkService, q: Array, until: int, start: Array | None = None) -> MemoryState | None:
        """The memory after the arm stood at q (n,), rad, until then."""
        seconds = max(0, until - self._since) / SECOND
        if self._remembered is None or not (seconds or start is not None):
            return self._remembered
        return service.after_stand(self._remembered, q, self._payload, seconds, start)

    def added_to(self, known: Known, service: IkService, now: int) -> Known:
        """What is known of the arm, with its memory now."""
        if self._remembered is None or known.motion is None:
            return known
        return replace(known, remembered=self._after(service, self._q, now))
