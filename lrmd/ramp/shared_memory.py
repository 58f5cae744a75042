"""Two fixed records in shared memory: orders go to the ramp, reports come back. One writer each, no locks.

A reader never takes half a record: each carries a checksum, and a record that was being written while it was read is
read again or given up for this time. Both survive the death of either process.
"""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar, Self

from lrmd.ramp.stepping import Pace

SERVOS = 16
NONE = (0,) * SERVOS
HERE = -(2**31)
"""As a target: stay where you are."""


class Trip(IntEnum):
    """Why the ramp froze. After a trip it takes no order that was made before the trip was seen."""

    NONE = 0
    STARTED = 1
    ESTOP = 2
    LINK_LOST = 3
    BOARD_RESTARTED = 4
    BOARD_SILENCED = 5
    API_SILENT = 6
    REFUSED = 7


class LinkState(IntEnum):
    """How far the ramp is with the board."""

    CLOSED = 0
    GREETING = 1
    READING = 2
    SETTING_UP = 3
    READY = 4


@dataclass(frozen=True, slots=True)
class Order:
    """What the ramp shall do. Absolute, so that only the newest counts; it is taken once, when `number` changes.

    `trips`: the number of trips that the sender had seen. `outputs`: bit i = servo i has pulses. `pose`: pulse (ns) of
    a servo that is switched on by this order. `target` (ns, or `HERE`), `stride` (ns per tick).
    `heartbeat`: monotonic ns.
    """

    LAYOUT: ClassVar[struct.Struct] = struct.Struct(f"<IqIHB{SERVOS}i{SERVOS}i{SERVOS}H")

    number: int = 0
    heartbeat: int = 0
    trips: int = 0
    outputs: int = 0
    pace: Pace = Pace.TOGETHER
    pose: tuple[int, ...] = NONE
    target: tuple[int, ...] = NONE
    stride: tuple[int, ...] = NONE

    def pack(self) -> bytes:
        """The record's bytes."""
        head = (self.number, self.heartbeat, self.trips, self.outputs, self.pace)
        return self.LAYOUT.pack(*head, *_padded(self.pose), *_padded(self.target), *_padded(self.stride))

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """The record from its bytes."""
        number, heartbeat, trips, outputs, pace, *rows = cls.LAYOUT.unpack(data)
        pose, target, stride = (tuple(rows[i * SERVOS : (i + 1) * SERVOS]) for i in range(3))
        return cls(number, heartbeat, trips, outputs, Pace(pace), pose, target, stride)


@dataclass(frozen=True, slots=True)
class Report:
    """What the ramp sees and does, written at every tick.

    `tick` counts deadlines kept, `time` is monotonic ns, `order` the number of the last order taken. `outputs`: servos
    that the ramp keeps pulsing. `position`: their pulses (ns), the last known ones of the others. `board_outputs` and
    `register`: what the board's chip was putting out when it was last asked (bit per servo, ns).
    `port_error`: errno of the last attempt to open the port, 0 if it succeeded.
    `taken` says whether order `order` was carried out (1) or dropped, because a trip came first (0).
    """

    LAYOUT: ClassVar[struct.Struct] = struct.Struct(f"<Qq11IHHHHBBBBB{SERVOS}i{SERVOS}i")

    tick: int = 0
    time: int = 0
    order: int = 0
    trips: int = 0
    sent: int = 0
    acknowledged: int = 0
    bad_frames: int = 0
    board_errors: int = 0
    reconnects: int = 0
    skipped: int = 0
    latest: int = 0
    starts: int = 0
    remaining: int = 0
    outputs: int = 0
    board_outputs: int = 0
    boot: int = 0
    port_error: int = 0
    link: LinkState = LinkState.CLOSED
    trip: Trip = Trip.NONE
    moving: bool = False
    taken: bool = False
    realtime: bool = False
    position: tuple[int, ...] = field(default=NONE)
    register: tuple[int, ...] = field(default=NONE)

    def pack(self) -> bytes:
        """The record's bytes."""
        return self.LAYOUT.pack(
            self.tick, self.time, self.order, self.trips, self.sent, self.acknowledged, self.bad_frames,
            self.board_errors, self.reconnects, self.skipped, self.latest, self.starts, self.remaining,
            self.outputs, self.board_outputs, self.boot, self.port_error, self.link, self.trip, self.moving,
            self.taken, self.realtime, *_padded(self.position), *_padded(self.register),
        )  # fmt: skip

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """The record from its bytes."""
        v = cls.LAYOUT.unpack(data)
        numbers = dict(zip(_NUMBERS, v, strict=False))
        link, trip, moving, taken, realtime = v[len(_NUMBERS) : -2 * SERVOS]
        position, register = v[-2 * SERVOS : -SERVOS], v[-SERVOS:]
        flags = {"moving": bool(moving), "taken": bool(taken), "realtime": bool(realtime)}
        return cls(**numbers, link=LinkState(link), trip=Trip(trip), **flags, position=position, register=register)


_NUMBERS = (
    "tick", "time", "order", "trips", "sent", "acknowledged", "bad_frames", "board_errors", "reconnects", "skipped",
    "latest", "starts", "remaining", "outputs", "board_outputs", "boot", "port_error",
)  # fmt: skip


def _padded(values: Sequence[int]) -> tuple[int, ...]:
    return (*values, *NONE[len(values) :])


_CHECK = struct.Struct("<I")


class Mailbox:
    """One record of `size` bytes at `offset` of a shared buffer, behind its CRC-32."""

    ATTEMPTS = 5

    def __init__(self, buffer: memoryview, offset: int, size: int) -> None:
        self._view = buffer[offset : offset + size + _CHECK.size]

    def write(self, record: bytes) -> None:
        """Puts a record in place of the last one."""
        self._view[:] = _CHECK.pack(zlib.crc32(record)) + record

    def read(self) -> bytes | None:
        """The last record, or None if none was ever written or the writer was at it every time."""
        for _ in range(self.ATTEMPTS):
            data = bytes(self._view)
            if zlib.crc32(data[_CHECK.size :]) == _CHECK.unpack_from(data)[0]:
                return data[_CHECK.size :]
        return None


BUCKET_NS, BUCKETS = 5_000, 512
"""The histogram of lateness: 512 buckets of 5 us; the last one also holds whatever is later."""

DIGEST = 32
"""Bytes of a SHA-256."""
NO_MODEL, NOMINAL = bytes(DIGEST), bytes(DIGEST - 1) + b"\1"
"""In place of a model file's digest: none yet, and the nominal arm, which has no file."""


class Shared:
    """The memory that the processes share, behind one descriptor: an order, a report, the histogram of lateness, and
    what the ik process is at.

    `lateness`: counts by bucket. `duty`: share of the tick that the ramp works, averaged over some. `ik`: [its last
    sign of life (ns, 0 = none yet), queries answered, refused]. `model`: SHA-256 of the model file that the
    daemon accepted, `ik_model`: of the one that the ik process answers with; see `NOMINAL` and `NO_MODEL`.
    """

    _ORDER = 0
    _REPORT = 1024
    _HISTOGRAM = 2048
    _IK = _HISTOGRAM + 8 * BUCKETS
    _DUTY = _IK + 8 * 3
    _MODEL = _DUTY + 8
    _IK_MODEL = _MODEL + DIGEST
    SIZE = _IK_MODEL + DIGEST

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._map = mmap.mmap(descriptor, self.SIZE)
        view = memoryview(self._map)
        self._order = Mailbox(view, self._ORDER, Order.LAYOUT.size)
        self._report = Mailbox(view, self._REPORT, Report.LAYOUT.size)
        self.lateness = view[self._HISTOGRAM : self._IK].cast("Q")
        self.ik = view[self._IK : self._DUTY].cast("Q")
        self._duty = view[self._DUTY : self._MODEL].cast("d")
        self._model, self._ik_model = view[self._MODEL : self._IK_MODEL], view[self._IK_MODEL : self.SIZE]

    @classmethod
    def create(cls) -> Shared:
        """New shared memory without a name: nothing is left behind, whoever dies."""
        descriptor = os.memfd_create("lrmd")
        os.ftruncate(descriptor, cls.SIZE)
        return cls(descriptor)

    @property
    def duty(self) -> float:
        """Share of the tick, 0 to 1."""
        return self._duty[0]

    @duty.setter
    def duty(self, share: float) -> None:
        self._duty[0] = share

    @property
    def model(self) -> bytes:
        """What the daemon accepted."""
        return bytes(self._model)

    @model.setter
    def model(self, digest: bytes) -> None:
        self._model[:] = digest

    @property
    def ik_model(self) -> bytes:
        """What the ik process answers with."""
        return bytes(self._ik_model)

    @ik_model.setter
    def ik_model(self, digest: bytes) -> None:
        self._ik_model[:] = digest

    def post(self, order: Order) -> None:
        """The API's side: leaves an order."""
        self._order.write(order.pack())

    def order(self) -> Order | None:
        """The ramp's side: the newest order."""
        data = self._order.read()
        return None if data is None else Order.unpack(data)

    def tell(self, report: Report) -> None:
        """The ramp's side: leaves a report."""
        self._report.write(report.pack())

    def report(self) -> Report | None:
        """Anybody's side: the newest report, None before the first."""
        data = self._report.read()
        return None if data is None else Report.unpack(data)
