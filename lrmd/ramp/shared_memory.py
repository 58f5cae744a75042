"""Fixed-layout records in shared memory: orders to the ramp, reports from it. One writer each, lock-free.

Each record carries a CRC-32; a torn read is retried, then given up for this time. Records outlive either process.
"""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Self

from lrmd.ramp.stepping import Pace

SERVOS = 16
NONE = (0,) * SERVOS
HOLD_PULSE = -(2**31)
"""As a target: keep the present pulse."""
AT_ONCE = 2**32 - 1
"""As `branch_at`: wherever the servos are."""


class RampFault(IntEnum):
    """Why the ramp froze its motion. It then drops every order whose sender had not seen the fault."""

    NONE = 0
    STARTED = 1
    ESTOP = 2
    LINK_LOST = 3
    BOARD_RESTARTED = 4
    BOARD_SILENCED = 5
    API_SILENT = 6
    REFUSED = 7


class LinkState(IntEnum):
    """State of the handshake with the board."""

    CLOSED = 0
    GREETING = 1
    READING = 2
    SETTING_UP = 3
    READY = 4


@dataclass(frozen=True, slots=True)
class RampOrder:
    """Command to the ramp. Absolute, so only the newest counts; it is executed once, when `number` changes.

    `fault_count`: faults that the sender had seen. `outputs`: bit i = servo i has pulses. `pose`: pulse (ns) of a servo
    that this order switches on. `target`: ns, or `HOLD_PULSE`. `stride`: ns per tick. `heartbeat`: monotonic ns.
    `branch_at`: where the motion begins: when so many ticks of the motion of order `after` remain, so that it begins
    at the pulses from which it was checked. If they are over by then, or that order was never read, the servos stop.
    """

    LAYOUT: ClassVar[struct.Struct] = struct.Struct(f"<IqIHBII{SERVOS}i{SERVOS}i{SERVOS}H")

    number: int = 0
    heartbeat: int = 0
    fault_count: int = 0
    outputs: int = 0
    pace: Pace = Pace.TOGETHER
    pose: tuple[int, ...] = NONE
    target: tuple[int, ...] = NONE
    stride: tuple[int, ...] = NONE
    after: int = 0
    branch_at: int = AT_ONCE

    def pack(self) -> bytes:
        """The record's bytes."""
        head = (
            self.number, self.heartbeat, self.fault_count, self.outputs, self.pace, self.after, self.branch_at,
        )  # fmt: skip
        return self.LAYOUT.pack(*head, *_padded(self.pose), *_padded(self.target), *_padded(self.stride))

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """The record from its bytes."""
        v = cls.LAYOUT.unpack(data)
        rows = v[7 : 7 + SERVOS], v[7 + SERVOS : 7 + 2 * SERVOS], v[7 + 2 * SERVOS :]
        return cls(v[0], v[1], v[2], v[3], Pace(v[4]), *rows, v[5], v[6])


@dataclass(frozen=True, slots=True)
class RampReport:
    """State of the ramp, written at every tick; the fields are in the order of `LAYOUT`.

    `tick` counts deadlines kept, `time` is monotonic ns, `order` the number of the last order read and
    `order_accepted` whether it was executed (dropped if a fault came first). `outputs`: servos that the ramp pulses;
    `position`: their pulses (ns), the last known ones of the others. `board_outputs`, `register`: outputs and pulses
    (ns) last read from the chip. `port_error`: errno of the last attempt to open the port, 0 if it succeeded.
    `other_version`: the protocol of a board that speaks another one than ours, else 0.
    """

    LAYOUT: ClassVar[struct.Struct] = struct.Struct(f"<Qq11IHHHHHBBBBB{SERVOS}i{SERVOS}i")

    tick: int = 0
    time: int = 0
    order: int = 0
    fault_count: int = 0
    sent: int = 0
    acknowledged: int = 0
    bad_frames: int = 0
    board_errors: int = 0
    reconnects: int = 0
    skipped: int = 0
    max_late_ns: int = 0
    starts: int = 0
    remaining: int = 0
    outputs: int = 0
    board_outputs: int = 0
    boot: int = 0
    port_error: int = 0
    other_version: int = 0
    link: LinkState = LinkState.CLOSED
    fault: RampFault = RampFault.NONE
    moving: bool = False
    order_accepted: bool = False
    realtime: bool = False
    position: tuple[int, ...] = NONE
    register: tuple[int, ...] = NONE

    def pack(self) -> bytes:
        """The record's bytes."""
        *scalars, position, register = (getattr(self, name) for name in self.__slots__)
        return self.LAYOUT.pack(*scalars, *_padded(position), *_padded(register))

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """The record from its bytes."""
        v = cls.LAYOUT.unpack(data)
        *numbers, link, fault, moving, accepted, realtime = v[: -2 * SERVOS]
        flags = map(bool, (moving, accepted, realtime))
        pulses = v[-2 * SERVOS : -SERVOS], v[-SERVOS:]
        fields: list[Any] = [*numbers, LinkState(link), RampFault(fault), *flags, *pulses]
        return cls(*fields)


def _padded(values: Sequence[int]) -> tuple[int, ...]:
    return (*values, *NONE[len(values) :])


_CHECK = struct.Struct("<I")
_PAYLOAD = struct.Struct("<d")


class Mailbox:
    """One record of `size` bytes at `offset` of a shared buffer, preceded by its CRC-32."""

    ATTEMPTS = 5

    def __init__(self, buffer: memoryview, offset: int, size: int) -> None:
        self._view = buffer[offset : offset + size + _CHECK.size]

    def write(self, record: bytes) -> None:
        """Replaces the record."""
        self._view[:] = _CHECK.pack(zlib.crc32(record)) + record

    def read(self) -> bytes | None:
        """The last record; None before the first, or if every attempt met a write in progress."""
        for _ in range(self.ATTEMPTS):
            data = bytes(self._view)
            if zlib.crc32(data[_CHECK.size :]) == _CHECK.unpack_from(data)[0]:
                return data[_CHECK.size :]
        return None


BUCKET_NS, BUCKETS = 5_000, 512
"""Histogram of lateness: 512 buckets of 5 us, the last one open."""

DIGEST = 32
"""Bytes of a SHA-256."""
NO_MODEL, NOMINAL = bytes(DIGEST), bytes(DIGEST - 1) + b"\1"
"""Digests for "no model yet" and for the nominal arm, which has no file."""
ESTOP_REASON_BYTES = 256


class SharedRecords:
    """Shared memory of the processes, behind one descriptor: order, report, lateness histogram, states of processes.

    `lateness`: counts per bucket. `ik`: [last heartbeat (ns, 0 = none yet), queries answered, refused]; `router`: [last
    heartbeat, emergency stops]. `model`: SHA-256 of the model file that the daemon accepted, `ik_model`: of the one in
    use by the ik process; see `NOMINAL` and `NO_MODEL`.
    """

    _ORDER = 0
    _REPORT = 1024
    _HISTOGRAM = 2048
    _IK = _HISTOGRAM + 8 * BUCKETS
    _DUTY = _IK + 8 * 3
    _MODEL = _DUTY + 8
    _IK_MODEL = _MODEL + DIGEST
    _ROUTER = _IK_MODEL + DIGEST
    _ESTOP_REASON = _ROUTER + 8 * 2
    _PAYLOAD = _ESTOP_REASON + _CHECK.size + ESTOP_REASON_BYTES
    SIZE = _PAYLOAD + 8

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._map = mmap.mmap(descriptor, self.SIZE)
        view = memoryview(self._map)
        self._order = Mailbox(view, self._ORDER, RampOrder.LAYOUT.size)
        self._report = Mailbox(view, self._REPORT, RampReport.LAYOUT.size)
        self.lateness = view[self._HISTOGRAM : self._IK].cast("Q")
        self.ik = view[self._IK : self._DUTY].cast("Q")
        self._duty = view[self._DUTY : self._MODEL].cast("d")
        self._model, self._ik_model = view[self._MODEL : self._IK_MODEL], view[self._IK_MODEL : self._ROUTER]
        self.router = view[self._ROUTER : self._ESTOP_REASON].cast("Q")
        self._payload = view[self._PAYLOAD : self.SIZE]
        self._estop_reason = Mailbox(view, self._ESTOP_REASON, ESTOP_REASON_BYTES)

    @classmethod
    def create(cls) -> SharedRecords:
        """Anonymous shared memory (memfd), freed with its last process."""
        descriptor = os.memfd_create("lrmd")
        os.ftruncate(descriptor, cls.SIZE)
        return cls(descriptor)

    @property
    def duty(self) -> float:
        """Share of the tick period that the ramp computes, 0 to 1, as a moving average."""
        return self._duty[0]

    @duty.setter
    def duty(self, share: float) -> None:
        self._duty[0] = share

    @property
    def payload(self) -> float:
        """What the arm carries (kg), for queries that do not say it."""
        return float(_PAYLOAD.unpack_from(self._payload)[0])

    @payload.setter
    def payload(self, mass: float) -> None:
        _PAYLOAD.pack_into(self._payload, 0, mass)

    @property
    def model(self) -> bytes:
        """Digest of the accepted model."""
        return bytes(self._model)

    @model.setter
    def model(self, digest: bytes) -> None:
        self._model[:] = digest

    @property
    def ik_model(self) -> bytes:
        """Digest of the model in use by the ik process."""
        return bytes(self._ik_model)

    @ik_model.setter
    def ik_model(self, digest: bytes) -> None:
        self._ik_model[:] = digest

    @property
    def estop_reason(self) -> str:
        """Why the last emergency stop was requested; empty if nobody said so."""
        return (self._estop_reason.read() or b"").rstrip(b"\0").decode(errors="replace")

    @estop_reason.setter
    def estop_reason(self, reason: str) -> None:
        self._estop_reason.write(reason.encode()[:ESTOP_REASON_BYTES].ljust(ESTOP_REASON_BYTES, b"\0"))

    def write_order(self, order: RampOrder) -> None:
        """Publishes an order (API process)."""
        self._order.write(order.pack())

    def read_order(self) -> RampOrder | None:
        """The newest order, None before the first (ramp process)."""
        data = self._order.read()
        return None if data is None else RampOrder.unpack(data)

    def write_report(self, report: RampReport) -> None:
        """Publishes a report (ramp process)."""
        self._report.write(report.pack())

    def read_report(self) -> RampReport | None:
        """The newest report, None before the first."""
        data = self._report.read()
        return None if data is None else RampReport.unpack(data)
