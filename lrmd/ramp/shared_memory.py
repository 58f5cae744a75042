"""Fixed-layout records in shared memory: orders to the ramp, reports from it. One writer each, lock-free.

Each record carries a CRC-32; a torn read is retried, then given up for this time. Records outlive either process.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import time
import zlib
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import cache
from typing import Annotated, Any, Self, TypeAlias, get_type_hints

from lrmd.ramp.stepping import Impulses, Pace, Waits

SERVOS = 16
NONE = (0,) * SERVOS
IMPULSES, WAITS = 64, 80
"""The most impulses and waits of a shaped motion."""
FRICTION_ELEMENTS = 3
"""Elements of friction of each joint, as many as `lrm_math.kinematics.motion` has."""
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


@dataclass(frozen=True, slots=True)
class Record:
    """A record whose fields are annotated with their C types; the default of each has its Python type."""

    @classmethod
    @cache
    def layout(cls) -> type[Layout]:
        """Bytes of the record."""
        hints = get_type_hints(cls, include_extras=True)
        types = [(field.name, hints[field.name].__metadata__[0]) for field in fields(cls)]
        return type(f"{cls.__name__}Layout", (Layout,), {"_fields_": types})

    def pack(self) -> bytes:
        """The record's bytes; rows that are shorter than the layout's end in zeros."""
        return bytes(self.layout()(**{field.name: getattr(self, field.name) for field in fields(self)}))

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """The record from its bytes."""
        raw = cls.layout().from_buffer_copy(data)
        kinds: dict[str, Any] = {field.name: type(field.default) for field in fields(cls)}
        return cls(**{name: kind(getattr(raw, name)) for name, kind in kinds.items()})


Count: TypeAlias = Annotated[int, ctypes.c_uint32]
Bits: TypeAlias = Annotated[int, ctypes.c_uint16]
Flag: TypeAlias = Annotated[bool, ctypes.c_bool]
Time: TypeAlias = Annotated[int, ctypes.c_int64]
Pulses: TypeAlias = Annotated[tuple[int, ...], ctypes.c_int32 * SERVOS]
Row: TypeAlias = Annotated[tuple[int, ...], ctypes.c_uint16 * IMPULSES]
WaitRow: TypeAlias = Annotated[tuple[int, ...], ctypes.c_uint16 * WAITS]
Numbers: TypeAlias = Annotated[tuple[float, ...], ctypes.c_double * SERVOS]


@dataclass(frozen=True, slots=True)
class RampOrder(Record):
    """Command to the ramp. Absolute, so only the newest counts; it is executed once, when `number` changes.

    `fault_count`: faults that the sender had seen. `outputs`: bit i = servo i has pulses. `pose`: pulse (ns) of a servo
    that this order switches on. `target`: ns, or `HOLD_PULSE`. `stride`: ns per tick. `heartbeat`: monotonic ns.
    `branch_at`: where the motion begins: when so many ticks of the motion of order `after` remain, so that it begins
    at the pulses from which it was checked. If they are over by then, or that order was never read, the servos stop.
    `delay`, `share`: impulses of a shaped motion (`stepping.Impulses`); no shares: it is not shaped.
    `wait_at`, `wait`: its waits (`stepping.Waits`); none where `wait` is 0.
    """

    number: Count = 0
    heartbeat: Time = 0
    fault_count: Count = 0
    outputs: Bits = 0
    pace: Annotated[Pace, ctypes.c_uint8] = Pace.TOGETHER
    pose: Pulses = NONE
    target: Pulses = NONE
    stride: Annotated[tuple[int, ...], ctypes.c_uint16 * SERVOS] = NONE
    after: Count = 0
    branch_at: Count = AT_ONCE
    delay: Row = (0,) * IMPULSES
    share: Row = (0,) * IMPULSES
    wait_at: WaitRow = (0,) * WAITS
    wait: WaitRow = (0,) * WAITS

    @property
    def impulses(self) -> Impulses:
        """Delay and share of each impulse."""
        return tuple((delay, share) for delay, share in zip(self.delay, self.share, strict=True) if share)

    @property
    def waits(self) -> Waits:
        """Remaining ticks and duration of each wait."""
        return tuple((at, ticks) for at, ticks in zip(self.wait_at, self.wait, strict=True) if ticks)


@dataclass(frozen=True, slots=True)
class RampReport(Record):
    """State of the ramp, written at every tick.

    `tick` counts deadlines kept, `time` is monotonic ns, `order` the number of the last order read and
    `order_accepted` whether it was executed (dropped if a fault came first). `outputs`: servos that the ramp pulses;
    `position`: their pulses (ns), the last known ones of the others. `turned_at`: the pulse (ns) at which each servo
    last turned round, or began to move. `board_outputs`, `register`: outputs and pulses (ns) last read from the chip,
    without the outputs that the ramp has ended since.
    `port_error`: errno of the last attempt to open the port, 0 if it succeeded.
    `other_version`: the protocol of a board that speaks another one than ours, else 0.
    """

    tick: Annotated[int, ctypes.c_uint64] = 0
    time: Time = 0
    order: Count = 0
    fault_count: Count = 0
    sent: Count = 0
    acknowledged: Count = 0
    bad_frames: Count = 0
    board_errors: Count = 0
    reconnects: Count = 0
    skipped: Count = 0
    max_late_ns: Count = 0
    starts: Count = 0
    remaining: Count = 0
    outputs: Bits = 0
    board_outputs: Bits = 0
    boot: Bits = 0
    port_error: Bits = 0
    other_version: Bits = 0
    link: Annotated[LinkState, ctypes.c_uint8] = LinkState.CLOSED
    fault: Annotated[RampFault, ctypes.c_uint8] = RampFault.NONE
    moving: Flag = False
    order_accepted: Flag = False
    realtime: Flag = False
    position: Pulses = NONE
    register: Pulses = NONE
    turned_at: Pulses = NONE


@dataclass(frozen=True, slots=True)
class ArmKnowledge(Record):
    """Knowledge of the API process about the arm, for the ik process; see `lrm_math.kinematics.known`.

    `joints`: number of joints whose moves are known, all or 0. `q`: their commands (rad). `side`, `friction`: of
    `Motion`, the latter joint by joint. `powered`: monotonic ns since when the joints have pulses, 0 without.
    `temperature` (degC), `warmed` (K).
    """

    joints: Bits = 0
    q: Numbers = ()
    side: Numbers = ()
    friction: Annotated[tuple[float, ...], ctypes.c_double * (SERVOS * FRICTION_ELEMENTS)] = ()
    powered: Time = 0
    temperature: Annotated[float, ctypes.c_double] = 0.0
    warmed: Annotated[float, ctypes.c_double] = 0.0


@dataclass(frozen=True, slots=True)
class GravityRecord(Record):
    """Direction of gravity that is known, a unit vector in the arm's frame; not `known`: the model's."""

    known: Flag = False
    x: Annotated[float, ctypes.c_double] = 0.0
    y: Annotated[float, ctypes.c_double] = 0.0
    z: Annotated[float, ctypes.c_double] = 0.0


@dataclass(frozen=True, slots=True)
class LoadRecord(Record):
    """What the gripper carries: its mass (kg), for queries that do not say it, and its centre (m)."""

    mass: Annotated[float, ctypes.c_double] = 0.0
    x: Annotated[float, ctypes.c_double] = 0.0
    y: Annotated[float, ctypes.c_double] = 0.0
    z: Annotated[float, ctypes.c_double] = 0.0


BUCKET_NS, BUCKETS = 5_000, 512
"""Histogram of lateness: 512 buckets of 5 us, the last one open."""
DIGEST = 64
"""Hexadecimal digits of a SHA-256."""
NO_MODEL, NOMINAL = b"", b"nominal"
"""Digests for "no model yet" and for the nominal arm, which has no file."""
ESTOP_REASON_BYTES = 256
SCENE_BYTES = 65_536
"""Room for the obstacles, with their length before them: 32 of the largest take 13 kB, and 4096 heights 37 kB."""
ATTEMPTS, CHECK = 5, 4
"""Readings of a record before it is given up for this time; bytes of the CRC-32 that precedes it."""


def _mailbox(content: type[Any]) -> type[Any]:
    return ctypes.c_uint8 * (CHECK + ctypes.sizeof(content))


class SharedValues(ctypes.Structure):
    """Bytes of the shared memory.

    `lateness`: counts per bucket. `ik`: [last heartbeat (ns, 0 = none yet), queries answered, refused]; `router`: [last
    heartbeat, emergency stops]. `duty`: share of the tick period that the ramp computes, 0 to 1, as a moving average.
    `load`: what the arm carries; `gravity`: its direction in use.
    `scene`: obstacles, `scene_number`: counts their changes. `model`: SHA-256 of the
    model file that the daemon accepted, `ik_model`: of the one in use by the ik process; see `NOMINAL` and `NO_MODEL`.
    """

    duty: float
    scene_number: int
    model: bytes
    ik_model: bytes
    _fields_ = (
        ("order", _mailbox(RampOrder.layout())), ("report", _mailbox(RampReport.layout())),
        ("knowledge", _mailbox(ArmKnowledge.layout())),
        ("estop_reason", _mailbox(ctypes.c_char * ESTOP_REASON_BYTES)), ("lateness", ctypes.c_uint64 * BUCKETS),
        ("ik", ctypes.c_uint64 * 3), ("router", ctypes.c_uint64 * 2), ("duty", ctypes.c_double),
        ("load", _mailbox(LoadRecord.layout())), ("gravity", _mailbox(GravityRecord.layout())),
        ("scene", _mailbox(ctypes.c_char * SCENE_BYTES)), ("scene_number", ctypes.c_uint64),
        ("model", ctypes.c_char * DIGEST), ("ik_model", ctypes.c_char * DIGEST),
    )  # fmt: skip


class SharedRecords:
    """Shared memory of the processes, behind one descriptor: order, report, knowledge of the arm, reason of the last
    emergency stop, and `values` without a check of their own, `lateness`, `ik` and `router` among them (see
    `SharedValues`)."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self.values = SharedValues.from_buffer(mmap.mmap(descriptor, ctypes.sizeof(SharedValues)))
        self.lateness, self.ik, self.router = self.values.lateness, self.values.ik, self.values.router

    @classmethod
    def create(cls) -> SharedRecords:
        """Anonymous shared memory (memfd), freed with its last process."""
        descriptor = os.memfd_create("lrmd")
        os.ftruncate(descriptor, ctypes.sizeof(SharedValues))
        return cls(descriptor)

    def _write(self, name: str, record: bytes) -> None:
        """Replaces a record."""
        memoryview(getattr(self.values, name)).cast("B")[:] = zlib.crc32(record).to_bytes(CHECK, "little") + record

    def _read(self, name: str) -> bytes | None:
        """The last record of a field; None before the first, or if every attempt met a write in progress."""
        for _ in range(ATTEMPTS):
            data = bytes(getattr(self.values, name))
            if zlib.crc32(data[CHECK:]) == int.from_bytes(data[:CHECK], "little"):
                return data[CHECK:]
        return None

    @property
    def estop_reason(self) -> str:
        """Reason of the last emergency stop; empty if nobody said so."""
        return (self._read("estop_reason") or b"").rstrip(b"\0").decode(errors="replace")

    @estop_reason.setter
    def estop_reason(self, reason: str) -> None:
        self._write("estop_reason", reason.encode()[:ESTOP_REASON_BYTES].ljust(ESTOP_REASON_BYTES, b"\0"))

    def write_order(self, order: RampOrder) -> None:
        """Publishes an order (API process)."""
        self._write("order", order.pack())

    def read_order(self) -> RampOrder | None:
        """The newest order, None before the first (ramp process)."""
        data = self._read("order")
        return None if data is None else RampOrder.unpack(data)

    def write_report(self, report: RampReport) -> None:
        """Publishes a report (ramp process)."""
        self._write("report", report.pack())

    def read_report(self) -> RampReport | None:
        """The newest report, None before the first."""
        data = self._read("report")
        return None if data is None else RampReport.unpack(data)

    def write_knowledge(self, knowledge: ArmKnowledge) -> None:
        """Publishes what is known of the arm (API process)."""
        self._write("knowledge", knowledge.pack())

    def read_knowledge(self) -> ArmKnowledge:
        """The newest knowledge of the arm; none before the first (ik process)."""
        data = self._read("knowledge")
        return ArmKnowledge() if data is None else ArmKnowledge.unpack(data)

    def write_gravity(self, gravity: GravityRecord) -> None:
        """Publishes the direction of gravity in use (API process)."""
        self._write("gravity", gravity.pack())

    def read_gravity(self) -> GravityRecord | None:
        """The direction of gravity in use, None before the first (ik process)."""
        data = self._read("gravity")
        return None if data is None else GravityRecord.unpack(data)

    def write_load(self, load: LoadRecord) -> None:
        """Publishes what the gripper carries (API process)."""
        self._write("load", load.pack())

    def read_load(self) -> LoadRecord | None:
        """What the gripper carries, None before the first (ik process)."""
        data = self._read("load")
        return None if data is None else LoadRecord.unpack(data)

    def write_scene(self, obstacles: bytes) -> None:
        """Publishes the obstacles (API process)."""
        record = len(obstacles).to_bytes(CHECK, "little") + obstacles
        if len(record) > SCENE_BYTES:
            raise ValueError(f"{len(obstacles)} bytes of obstacles; there is room for {SCENE_BYTES - CHECK}")
        self._write("scene", record.ljust(SCENE_BYTES, b"\0"))
        self.values.scene_number += 1

    def read_scene(self) -> bytes | None:
        """The obstacles, None before the first, or where every attempt met a write in progress (ik process)."""
        data = self._read("scene")
        return None if data is None else data[CHECK : CHECK + int.from_bytes(data[:CHECK], "little")]

    def wait_for_order(self, number: int, timeout: int) -> bool:
        """Waits until the ramp has read an order or a later one, at most for `timeout` (ns); whether it has."""
        deadline = time.monotonic_ns() + timeout
        while (report := self.read_report()) is None or (report.order - number) % 2**32 >= 2**31:
            if time.monotonic_ns() >= deadline:
                return False
            time.sleep(0.001)
        return True
