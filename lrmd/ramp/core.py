"""What the ramp process does at one tick, without clock, port or memory: bytes and an order in, bytes and a report out.

Laws that hold whatever comes in:
- A pulse that the board puts out changes by at most one step per tick, and only after the board acknowledged the frame
  before. So a stall or lost frames lengthen a move; they never add up to a jump.
- A servo is switched on only by a new order that knows of every trip so far. Nothing resumes by itself.
- A pulse outside the servo's limits is never sent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lrm_math.arm.servo_table import PwmClock
from lrmd.config import MS, Config, Servo
from lrmd.link import protocol
from lrmd.link.protocol import Bad, ErrorCode, Frame, FrameType, ProtocolError, Status
from lrmd.ramp.shared_memory import HERE, LinkState, Order, Report, Trip
from lrmd.ramp.stepping import Move, move

API_SILENCE = 500_000_000
"""ns: a move goes on without a sign of life of the API process for this long, then it freezes."""


@dataclass(frozen=True)
class Board:
    """What the ramp needs to know of the board and its servos. `reply`, ns; `step`, ns of pulse per tick.

    `simulated`: the clock is not the real one, so that no real board may be driven by it.
    """

    servos: tuple[Servo, ...]
    clock: PwmClock
    step: int
    reply: int
    silence_ms: int
    simulated: bool = False

    @classmethod
    def of(cls, config: Config, speed: float = 1.0) -> Board:
        """From the daemon's configuration, for a clock that runs `speed` times as fast as the real one."""
        return cls(config.servos, config.clock, config.step, config.reply, config.link.silence_ms, speed != 1.0)

    def counts(self, outputs: int, position: Sequence[int]) -> tuple[int, ...]:
        """OFF count of every servo: the nearest to its pulse (ns), 0 where it has none."""
        per_ns = 1e-9 / self.clock.count_s
        return tuple(int(p * per_ns + 0.5) if outputs >> i & 1 else 0 for i, p in enumerate(position))

    def pulse(self, count: int) -> int:
        """Pulse (ns) that the chip puts out for a count."""
        return round(count * self.clock.count_s * 1e9)


class RampCore:
    """The ramp between two ticks. `earlier` is the last report of a ramp process that died, if there was one."""

    def __init__(self, board: Board, earlier: Report | None = None) -> None:
        self._board = board
        self._channels = tuple(servo.channel for servo in board.servos)
        self._mask = sum(1 << channel for channel in self._channels)
        self._by_channel = sorted(range(len(self._channels)), key=lambda i: self._channels[i])
        earlier = earlier or Report()
        n = len(board.servos)
        self.outputs = earlier.outputs
        self.position: tuple[int, ...] = earlier.position[:n]
        self.register: tuple[int, ...] = earlier.register[:n]
        self.board_outputs = 0
        self.boot = earlier.boot
        self.order = earlier.order
        self.taken = earlier.taken
        self.trips, self.trip = earlier.trips, earlier.trip
        self.sent, self.acknowledged = earlier.sent, earlier.acknowledged
        self.bad_frames, self.board_errors = earlier.bad_frames, earlier.board_errors
        self.reconnects = earlier.reconnects
        self.link = LinkState.CLOSED
        self._decoder = protocol.Decoder()
        self._move: Move | None = None
        self._k = 0
        self._seq = 0
        self._first = 0
        self._changed, self._settled = False, True
        self._answered = self._spoke = 0
        self._trip(Trip.STARTED)

    @property
    def moving(self) -> bool:
        """Whether a move is under way."""
        return self._move is not None

    @property
    def remaining(self) -> int:
        """Ticks until the move ends, if no frame is lost."""
        return 0 if self._move is None else self._move.length - self._k

    def tick(self, now: int, alive: int, order: Order | None, received: bytes | None, estop: bool) -> bytes:
        """One tick at `now` (ns): the bytes to send.

        `alive` is the clock (ns) that `order.heartbeat` is told in. `received` is what came from the port since the
        last tick, None while it is closed.
        """
        if received is None:
            self.close()
        else:
            self._hear(now, received)
        if estop:
            self._stop_pulses(Trip.ESTOP)
        if order is not None:
            self._consider(order, alive)
        if self.link is LinkState.CLOSED:
            return b""
        paused = now - self._spoke > self._board.silence_ms * MS // 2 and self.link is LinkState.READY
        if paused or now - self._answered > self._board.reply:
            self._lose(now)
        self._spoke = now
        return self._speak()

    def opened(self, now: int) -> None:
        """The port was opened: asks who is there."""
        self._decoder = protocol.Decoder()
        self.link, self._answered = LinkState.GREETING, now
        self.reconnects += 1

    def close(self) -> None:
        """The port is gone."""
        if self.link is not LinkState.CLOSED:
            was_ready = self.link is LinkState.READY
            self.link = LinkState.CLOSED
            if was_ready:
                self._trip(Trip.LINK_LOST)

    def _lose(self, now: int) -> None:
        """No answer, or no tick of ours, for too long: asks again who is there before any pulse."""
        was_ready = self.link is LinkState.READY
        self.link, self._answered = LinkState.GREETING, now
        if was_ready:
            self._trip(Trip.LINK_LOST)

    def _trip(self, why: Trip) -> None:
        self._move, self._k = None, 0
        self.trips, self.trip = self.trips + 1, why

    def _stop_pulses(self, why: Trip) -> None:
        self.outputs, self._changed, self._settled = 0, True, False
        self._trip(why)

    # ---- what the board says

    def _hear(self, now: int, data: bytes) -> None:
        for event in self._decoder.feed(data):
            if isinstance(event, Bad):
                self.bad_frames += 1
                continue
            try:
                understood = self._take(event)
            except ProtocolError:
                self.bad_frames += 1
                continue
            if understood:
                self._answered = now

    def _take(self, frame: Frame) -> bool:
        match frame.type:
            case FrameType.ACK:
                answer = protocol.ack_of(frame)
                self._check_board(answer.status, answer.boot)
                self._acknowledge(frame.seq)
            case FrameType.INFO:
                self._greeted(protocol.info_of(frame))
            case FrameType.STATE:
                self._adopt(protocol.state_of(frame))
            case FrameType.ERROR:
                self.board_errors += 1
                if protocol.error_of(frame).code is ErrorCode.NOT_SET_UP:
                    self.link = LinkState.GREETING
                return False
            case _:
                return False
        return True

    def _acknowledge(self, seq: int) -> None:
        """An ACK settles the pulses if it answers any frame since they last changed."""
        if self.link is LinkState.SETTING_UP:
            self.link = LinkState.READY
            return
        self.acknowledged += 1
        if not self._changed and (seq - self._first) & 0xFF <= (self._seq - self._first) & 0xFF:
            self._settled = True

    def _check_board(self, status: Status, boot: int) -> None:
        """Notices pulses that stopped without our doing: the arm may have sagged, so they stay off until armed."""
        restarted = self.boot not in (0, boot)
        self.boot = boot
        if self.outputs and restarted:
            self._stop_pulses(Trip.BOARD_RESTARTED)
        elif self.outputs and Status.SILENCED in status:
            self._stop_pulses(Trip.BOARD_SILENCED)
        if restarted or Status.PULSING not in status:
            self.board_outputs = 0
        if self.link is LinkState.READY and Status.SET_UP not in status:
            self.link = LinkState.GREETING

    def _greeted(self, info: protocol.Info) -> None:
        if self._board.simulated and not info.simulated:
            return
        self._check_board(info.status, info.boot)
        if self.link is not LinkState.GREETING or Status.CHIP_FAULT in info.status:
            return
        as_wanted = info.prescale == self._board.clock.prescale and info.silence_ms == self._board.silence_ms
        if Status.PULSING in info.status:
            if as_wanted and Status.SET_UP in info.status:
                self.link = LinkState.READING
            return
        if self.outputs:
            self._stop_pulses(Trip.BOARD_SILENCED)
        self._changed, self._settled = False, True
        self.link = LinkState.READY if as_wanted and Status.SET_UP in info.status else LinkState.SETTING_UP

    def _adopt(self, counts: dict[int, int]) -> None:
        """Takes over what a pulsing board puts out: exactly its registers, and nothing else until a new order."""
        if self.link is not LinkState.READING or set(counts) != set(self._channels):
            return
        found = tuple(counts[channel] for channel in self._channels)
        self.board_outputs = sum(1 << i for i, count in enumerate(found) if count)
        self.register = tuple(self._board.pulse(count) for count in found)
        if self.outputs & ~self.board_outputs:
            self.outputs &= self.board_outputs
            self._trip(Trip.BOARD_SILENCED)
        ours = self._board.counts(self.outputs, self.position)
        self.position = tuple(
            p if count in (0, mine) else pulse
            for p, mine, count, pulse in zip(self.position, ours, found, self.register, strict=True)
        )
        self._changed = self._changed or bool(self.outputs)
        self._settled = not self._changed
        self.link = LinkState.READY

    # ---- what the API asks for

    def _consider(self, order: Order, alive: int) -> None:
        if self._move is not None and alive - order.heartbeat > API_SILENCE:
            self._trip(Trip.API_SILENT)
        if order.number == self.order:
            return
        self.order = order.number
        self.taken = order.trips == self.trips and self.link is LinkState.READY
        if self.taken:
            self._obey(order)

    def _obey(self, order: Order) -> None:
        n = len(self._channels)
        fresh = order.outputs & ~self.outputs
        start = tuple(order.pose[i] if fresh >> i & 1 else self.position[i] for i in range(n))
        target = tuple(
            order.target[i] if order.outputs >> i & 1 and order.target[i] != HERE else start[i] for i in range(n)
        )
        for i, servo in enumerate(self._board.servos):
            inside = servo.lowest <= start[i] <= servo.highest and servo.lowest <= target[i] <= servo.highest
            stride_fits = 0 < order.stride[i] <= self._board.step
            if order.outputs >> i & 1 and not (inside and stride_fits):
                self.taken = False
                self._trip(Trip.REFUSED)
                return
        self._changed = True
        self.outputs, self.position = order.outputs, start
        going = move(start, target, tuple(max(1, s) for s in order.stride[:n]), order.pace)
        self._move, self._k = (going if going.length else None), 0

    # ---- what goes to the board

    def _speak(self) -> bytes:
        self._seq = (self._seq + 1) & 0xFF
        match self.link:
            case LinkState.GREETING:
                frame = protocol.hello(self._seq)
            case LinkState.READING:
                frame = protocol.read(self._seq, self._channels)
            case LinkState.SETTING_UP:
                frame = protocol.setup(self._seq, self._board.clock.prescale, self._board.silence_ms)
            case _:
                idle = not self.outputs and self._settled and not self._changed
                frame = protocol.hello(self._seq) if idle else self._pulses()
        self.sent += 1
        return protocol.encode(frame)

    def _pulses(self) -> Frame:
        if self._settled and self._move is not None:
            self._step(self._move)
        if self._changed:
            self._changed, self._settled, self._first = False, False, self._seq
        counts = self._board.counts(self.outputs, self.position)
        return Frame(FrameType.ARM, self._seq, self._mask, tuple(counts[i] for i in self._by_channel))

    def _step(self, going: Move) -> None:
        self._k += 1
        self.position, self._changed = going.at(self._k), True
        if self._k >= going.length:
            self._move, self._k = None, 0

    def report(
        self, tick: int, time: int, skipped: int, latest: int, starts: int, realtime: bool, port_error: int = 0
    ) -> Report:
        """What to tell the API after a tick."""
        return Report(
            tick, time, self.order, self.trips, self.sent, self.acknowledged, self.bad_frames, self.board_errors,
            self.reconnects, skipped, latest, starts, self.remaining, self.outputs, self.board_outputs, self.boot,
            port_error, self.link, self.trip, self.moving, self.taken, realtime, self.position, self.register,
        )  # fmt: skip
