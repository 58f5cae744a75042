"""Fixed-layout records in shared memory: orders to the ramp, reports from it. One writer each, lock-free.

Each record carries a CRC-32; a torn read is retried, then given up for this time. Records outlive either process.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import zlib
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, ClassVar, Self

from lrmd.ramp.stepping import Pace

I32, I64 = ctypes.c_int32, ctypes.c_int64
U8, U16, U32, U64 = ctypes.c_uint8, ctypes.c_uint16, ctypes.c_uint32, ctypes.c_uint64
SERVOS = 16
NONE = (0,) * SERVOS
HOLD_PULSE = -(2**31)
"""Target that keeps the present pulse."""
AT_ONCE = 2**32 - 1
"""`branch_at` of an order from wherever the servos are."""


class RampFault(IntEnum):
    """Reason why the ramp froze its motion. It then drops every order whose sender had not seen the fault."""

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


class Layout(ctypes.LittleEndianStructure):
    """Bytes of a record; its fields have the names of the record's."""

    _pack_ = 1


class OrderLayout(Layout):
    """Bytes of a `RampOrder`."""

    _fields_ = (
        ("number", U32), ("heartbeat", I64), ("fault_count", U32), ("outputs", U16),
        ("pace", U8), ("pose", I32 * SERVOS), ("target", I32 * SERVOS), ("stride", U16 * SERVOS),
        ("after", U32), ("branch_at", U32),
    )  # fmt: skip


class ReportLayout(Layout):
    """Bytes of a `RampReport`."""

    _fields_ = (
        ("tick", U64), ("time", I64),
        *((name, U32) for name in (
            "order", "fault_count", "sent", "acknowledged", "bad_frames", "board_errors", "reconnects", "skipped",
            "max_late_ns", "starts", "remaining",
        )),
        *((name, U16) for name in ("outputs", "board_outputs", "boot", "port_error", "other_version")),
        ("link", U8), ("fault", U8), *((name, ctypes.c_bool) for name in ("moving", "order_accepted", "realtime")),
        ("position", I32 * SERVOS), ("register", I32 * SERVOS),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Record:
    """A record with a `LAYOUT`; the default of each field has its type."""

    LAYOUT: ClassVar[type[Layout]]

    def pack(self) -> bytes:
        """The record's bytes; rows that are shorter than the layout's end in zeros."""
        return bytes(self.LAYOUT(**{field.name: getattr(self, field.name) for field in fields(self)}))

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """The record from its bytes."""
        raw = cls.LAYOUT.from_buffer_copy(data)
        kinds: dict[str, Any] = {field.name: type(field.default) for field in fields(cls)}
        return cls(**{name: kind(getattr(raw, name)) for name, kind in kinds.items()})


@dataclass(frozen=True, slots=True)
class RampOrder(Record):
    """Command to the ramp. Absolute, so only the newest counts; it is executed once, when `number` changes.

    `fault_count`: faults that the sender had seen. `outputs`: bit i = servo i has pulses. `pose`: pulse (ns) of a servo
    that this order switches on. `target`: ns, or `HOLD_PULSE`. `stride`: ns per tick. `heartbeat`: monotonic ns.
    `branch_at`: where the motion begins: when so many ticks of the motion of order `after` remain, so that it begins
    at the pulses from which it was checked. If they are over by then, or that order was never read, the servos stop.
    """

    LAYOUT = OrderLayout

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


@dataclass(frozen=True, slots=True)
class RampReport(Record):
    """State of the ramp, written at every tick.

    `tick` counts deadlines kept, `time` is monotonic ns, `order` the number of the last order read and
    `order_accepted` whether it was executed (dropped if a fault came first). `outputs`: servos that the ramp pulses;
    `position`: their pulses (ns), the last known ones of the others. `board_outputs`, `register`: outputs and pulses
    (ns) last read from the chip. `port_error`: errno of the last attempt to open the port, 0 if it succeeded.
    `other_version`: the protocol of a board that speaks another one than ours, else 0.
    """

    LAYOUT = ReportLayout

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


class Mailbox:
    """One record in a buffer, preceded by its CRC-32."""

    ATTEMPTS = 5
    CHECK = 4

    def __init__(self, buffer: memoryview) -> None:
        self._view = buffer

    def write(self, record: bytes) -> None:
        """Replaces the record."""
        self._view[:] = zlib.crc32(record).to_bytes(self.CHECK, "little") + record

    def read(self) -> bytes | None:
        """The last record; None before the first, or if every attempt met a write in progress."""
        for _ in range(self.ATTEMPTS):
            data = bytes(self._view)
            if zlib.crc32(data[self.CHECK :]) == int.from_bytes(data[: self.CHECK], "little"):
                return data[self.CHECK :]
        return None


BUCKET_NS, BUCKETS = 5_000, 512
"""Histogram of lateness: 512 buckets of 5 us, the last one open."""

DIGEST = 32
"""Bytes of a SHA-256."""
NO_MODEL, NOMINAL = bytes(DIGEST), bytes(DIGEST - 1) + b"\1"
"""Digests for "no model yet" and for the nominal arm, which has no file."""
ESTOP_REASON_BYTES = 256


def _mailbox(size: int) -> type[Any]:
    return U8 * (Mailbox.CHECK + size)


class SharedLayout(ctypes.Structure):
    """Bytes of the shared memory."""

    _fields_ = (
        ("order", _mailbox(ctypes.sizeof(OrderLayout))), ("report", _mailbox(ctypes.sizeof(ReportLayout))),
        ("estop_reason", _mailbox(ESTOP_REASON_BYTES)), ("lateness", U64 * BUCKETS), ("ik", U64 * 3),
        ("router", U64 * 2), ("duty", ctypes.c_double), ("payload", ctypes.c_double), ("model", U8 * DIGEST),
        ("ik_model", U8 * DIGEST),
    )  # fmt: skip


class SharedRecords:
    """Shared memory of the processes, behind one descriptor: order, report, lateness histogram, states of processes.

    `lateness`: counts per bucket. `ik`: [last heartbeat (ns, 0 = none yet), queries answered, refused]; `router`: [last
    heartbeat, emergency stops]. `model`: SHA-256 of the model file that the daemon accepted, `ik_model`: of the one in
    use by the ik process; see `NOMINAL` and `NO_MODEL`.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        memory = mmap.mmap(descriptor, ctypes.sizeof(SharedLayout))
        self._memory = SharedLayout.from_buffer(memory)
        self.lateness, self.ik, self.router = self._memory.lateness, self._memory.ik, self._memory.router

        def mailbox(name: str) -> Mailbox:
            """The mailbox of a field."""
            field = getattr(SharedLayout, name)
            return Mailbox(memoryview(memory)[field.offset : field.offset + field.size])

        self._order, self._report, self._estop_reason = map(mailbox, ("order", "report", "estop_reason"))

    @classmethod
    def create(cls) -> SharedRecords:
        """Anonymous shared memory (memfd), freed with its last process."""
        descriptor = os.memfd_create("lrmd")
        os.ftruncate(descriptor, ctypes.sizeof(SharedLayout))
        return cls(descriptor)

    @property
    def duty(self) -> float:
        """Share of the tick period that the ramp computes, 0 to 1, as a moving average."""
        return float(self._memory.duty)

    @duty.setter
    def duty(self, share: float) -> None:
        self._memory.duty = share

    @property
    def payload(self) -> float:
        """Payload of the arm (kg), for queries that do not say it."""
        return float(self._memory.payload)

    @payload.setter
    def payload(self, mass: float) -> None:
        self._memory.payload = mass

    @property
    def model(self) -> bytes:
        """Digest of the accepted model."""
        return bytes(self._memory.model)

    @model.setter
    def model(self, digest: bytes) -> None:
        self._memory.model[:] = digest

    @property
    def ik_model(self) -> bytes:
        """Digest of the model in use by the ik process."""
        return bytes(self._memory.ik_model)

    @ik_model.setter
    def ik_model(self, digest: bytes) -> None:
        self._memory.ik_model[:] = digest

    @property
    def estop_reason(self) -> str:
        """Reason of the last emergency stop; empty if nobody said so."""
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
