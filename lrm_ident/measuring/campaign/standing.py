"""The daemon's word that an arm stands: the same before and after a rest, nobody has moved it or let it fall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from lrmd.client import Rover

STILL = ("armed", "holding")
"""Modes of an arm that stands with pulses on."""
REACHED = 1e-5
"""rad; commanded pulses are whole ns, 2e-6 rad."""


@dataclass(frozen=True)
class Standing:
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

    def stands_at(self, goal: Sequence[float]) -> bool:
        """Whether the arm stands at angles of its joints (rad)."""
        there = all(abs(a - b) < REACHED for a, b in zip(self.q, goal, strict=False))
        return self.mode in STILL and there and all(self.on[: len(goal)])

    def changed_to(self, now: Standing) -> str:
        """Differences from then, in words; empty if everything is."""
        changes = {
            "the daemon was restarted": self.boot_id != now.boot_id,
            "the lease was acquired anew": self.lease != now.lease,
            f"the arm is {now.mode} ({now.why})": (self.mode, self.since) != (now.mode, now.since),
            "other angles are commanded": self.q != now.q,
            "other servos have pulses": self.on != now.on,
        }
        return "; ".join(words for words, changed in changes.items() if changed)
