"""Sans-io core of the ramp process: per tick, received bytes and an order in; bytes to send and a report out.

Invariants for any input:
- A pulse that the board puts out changes by at most one step per tick, and only after the board acknowledged the frame
  before. So a stall or lost frames lengthen a move; they never add up to a jump.
- A servo is switched on only by a new order whose sender has seen every fault so far. No motion resumes by itself.
- A pulse outside the servo's limits is never sent.
"""

from __future__ import annotations

from lrmd.link import protocol
from lrmd.link.frames import BadFrame, Frame, FrameDecoder, FrameType, ProtocolError, encode
from lrmd.link.protocol import BoardStatus, ErrorCode
from lrmd.ramp.board_settings import BoardSettings
from lrmd.ramp.shared_memory import AT_ONCE, HOLD_PULSE, LinkState, RampFault, RampOrder, RampReport
from lrmd.ramp.stepping import Way, move

API_TIMEOUT = 500_000_000
"""ns without a heartbeat of the API process after which a move is frozen."""


class RampCore:
    """State of the ramp; continues counters and pulses of `earlier`, the last report of a previous ramp process."""

    def __init__(self, board: BoardSettings, earlier: RampReport | None = None) -> None:
        self._board = board
        self._channels = tuple(servo.channel for servo in board.servos)
        self._mask = sum(1 << channel for channel in self._channels)
        self._by_channel = sorted(range(len(self._channels)), key=lambda i: self._channels[i])
        earlier = earlier or RampReport()
        n = len(board.servos)
        self.outputs, self.board_outputs = earlier.outputs, 0
        self.position: tuple[int, ...] = earlier.position[:n]
        self.register: tuple[int, ...] = earlier.register[:n]
        self.boot, self.order, self.order_accepted = earlier.boot, earlier.order, earlier.order_accepted
        self.fault_count, self.fault = earlier.fault_count, earlier.fault
        self.sent, self.acknowledged = earlier.sent, earlier.acknowledged
        self.bad_frames, self.board_errors = earlier.bad_frames, earlier.board_errors
        self.reconnects = earlier.reconnects
        self.link, self.other_version = LinkState.CLOSED, 0
        self._decoder = FrameDecoder()
        self._way = Way()
        self._seq = self._first_seq = 0
        self._pulses_changed, self._pulses_confirmed = False, True
        self._last_sent = self._unanswered = 0  # ns: time of the last frame sent; waiting time since the last reply
        self._freeze(RampFault.STARTED)

    @property
    def moving(self) -> bool:
        """Whether a move is in progress."""
        return bool(self._way.parts)

    @property
    def standing_by(self) -> bool:
        """Whether no servo has pulses and the board replied to the last frame, so that slower ticks delay nothing."""
        resting = not self.outputs and not self.board_outputs and self._pulses_confirmed
        return resting and self.link is LinkState.READY and not self._unanswered

    @property
    def remaining(self) -> int:
        """Ticks left in the motion if no frame is lost."""
        return self._way.remaining

    def tick(self, now: int, alive: int, order: RampOrder | None, received: bytes | None, estop: bool) -> bytes:
        """Runs one tick at `now` (ns) and returns the bytes to send.

        `alive`: time (ns) on the clock of `order.heartbeat`. `received`: bytes from the port since the last tick, None
        while it is closed.
        """
        self._unanswered += min(now - self._last_sent, self._board.reply // 2)
        if received is None:
            self.close()
        else:
            self._receive(received)
        if estop:
            self._stop_pulses(RampFault.ESTOP)
        if order is not None:
            self._check_order(order, alive)
        if self.link is LinkState.CLOSED:
            return b""
        paused = now - self._last_sent > self._board.pause and self.link is LinkState.READY
        if paused or self._unanswered > self._board.reply:
            self._reconnect()
        self._last_sent = now
        return self._next_frame()

    def opened(self, now: int) -> None:
        """The port was opened: restarts the handshake with HELLO."""
        self._decoder = FrameDecoder()
        self.link, self._last_sent, self._unanswered, self.other_version = LinkState.GREETING, now, 0, 0
        self.reconnects += 1

    def close(self) -> None:
        """The port was closed or lost."""
        self._leave_link(LinkState.CLOSED)

    def _leave_link(self, link: LinkState) -> None:
        was_ready, self.link = self.link is LinkState.READY, link
        if was_ready:
            self._freeze(RampFault.LINK_LOST)

    def _reconnect(self) -> None:
        """Reply timeout, or a gap in our own ticks: repeats the handshake before any further pulse."""
        self._leave_link(LinkState.GREETING)
        self._unanswered = 0

    def _freeze(self, why: RampFault) -> None:
        self._way = Way()
        self.fault_count, self.fault = self.fault_count + 1, why

    def _stop_pulses(self, why: RampFault) -> None:
        self.outputs, self._pulses_changed, self._pulses_confirmed = 0, True, False
        self._freeze(why)

    # ---- frames from the board

    def _receive(self, data: bytes) -> None:
        for event in self._decoder.feed(data):
            try:
                if isinstance(event, BadFrame):
                    self.bad_frames += 1
                elif self._handle_frame(event):
                    self._unanswered = 0
            except protocol.OtherVersion as other:
                self.bad_frames += self.link is LinkState.READY
                self.other_version = other.version if self.link is LinkState.GREETING else self.other_version
            except ProtocolError:
                self.bad_frames += 1

    def _handle_frame(self, frame: Frame) -> bool:
        match frame.type:
            case FrameType.ACK:
                answer = protocol.ack_of(frame)
                self._check_board(answer.status, answer.boot)
                self._acknowledge(frame.seq)
            case FrameType.INFO:
                self._on_info(protocol.info_of(frame))
            case FrameType.STATE:
                self._adopt_registers(protocol.state_of(frame))
            case FrameType.ERROR:
                self.board_errors += 1
                if protocol.error_of(frame).code is ErrorCode.NOT_SET_UP:
                    self.link = LinkState.GREETING
                return False
            case _:
                return False
        return True

    def _acknowledge(self, seq: int) -> None:
        """An ACK of any frame since the last change of the pulses confirms them."""
        if self.link is LinkState.SETTING_UP:
            self.link = LinkState.READY
            return
        self.acknowledged += 1
        if not self._pulses_changed and (seq - self._first_seq) & 0xFF <= (self._seq - self._first_seq) & 0xFF:
            self._pulses_confirmed = True

    def _check_board(self, status: BoardStatus, boot: int) -> None:
        """Detects pulses that the board stopped by itself: the arm may have sagged, so they stay off until armed."""
        restarted = self.boot not in (0, boot)
        self.boot = boot
        if self.outputs and restarted:
            self._stop_pulses(RampFault.BOARD_RESTARTED)
        elif self.outputs and BoardStatus.SILENCED in status:
            self._stop_pulses(RampFault.BOARD_SILENCED)
        if restarted or BoardStatus.PULSING not in status:
            self.board_outputs = 0
        if self.link is LinkState.READY and BoardStatus.SET_UP not in status:
            self.link = LinkState.GREETING

    def _on_info(self, info: protocol.BoardInfo) -> None:
        if self._board.simulated and not info.simulated:
            return
        self._check_board(info.status, info.boot)
        self.other_version = 0
        if self.link is not LinkState.GREETING or BoardStatus.CHIP_FAULT in info.status:
            return
        as_wanted = info.prescale == self._board.prescale and info.silence_ms == self._board.silence_ms
        if BoardStatus.PULSING in info.status:
            if as_wanted and BoardStatus.SET_UP in info.status:
                self.link = LinkState.READING
            return
        if self.outputs:
            self._stop_pulses(RampFault.BOARD_SILENCED)
        self._pulses_changed, self._pulses_confirmed = False, True
        self.link = LinkState.READY if as_wanted and BoardStatus.SET_UP in info.status else LinkState.SETTING_UP

    def _adopt_registers(self, counts: dict[int, int]) -> None:
        """Adopts the registers of a board that is still pulsing as the present position."""
        if self.link is not LinkState.READING or set(counts) != set(self._channels):
            return
        read = tuple(counts[channel] for channel in self._channels)
        self.board_outputs = sum(1 << i for i, count in enumerate(read) if count)
        self.register = tuple(self._board.pulse(count) for count in read)
        if self.outputs & ~self.board_outputs:
            self.outputs &= self.board_outputs
            self._freeze(RampFault.BOARD_SILENCED)
        ours = self._board.counts(self.outputs, self.position)
        self.position = tuple(
            p if count in (0, own) else pulse
            for p, own, count, pulse in zip(self.position, ours, read, self.register, strict=True)
        )
        self._pulses_changed = self._pulses_changed or bool(self.outputs)
        self._pulses_confirmed = not self._pulses_changed
        self.link = LinkState.READY

    # ---- orders from the API process

    def _check_order(self, order: RampOrder, alive: int) -> None:
        if self.moving and alive - order.heartbeat > API_TIMEOUT:
            self._freeze(RampFault.API_SILENT)
        if order.number == self.order:
            return
        in_time = order.branch_at == AT_ONCE or (order.after == self.order and order.branch_at <= self.remaining)
        self.order = order.number
        self.order_accepted = in_time and order.fault_count == self.fault_count and self.link is LinkState.READY
        if self.order_accepted:
            self._start_order(order)
        else:
            self._way = Way()

    def _start_order(self, order: RampOrder) -> None:
        n = len(self._channels)
        fresh = order.outputs & ~self.outputs
        way = Way() if order.branch_at == AT_ONCE else self._way
        there = way.at(order.branch_at) if way.parts else self.position
        start = tuple(order.pose[i] if fresh >> i & 1 else there[i] for i in range(n))
        target = tuple(
            order.target[i] if order.outputs >> i & 1 and order.target[i] != HOLD_PULSE else start[i] for i in range(n)
        )
        for i, servo in enumerate(self._board.servos):
            inside = servo.lowest <= start[i] <= servo.highest and servo.lowest <= target[i] <= servo.highest
            stride_fits = 0 < order.stride[i] <= self._board.step
            if order.outputs >> i & 1 and not (inside and stride_fits):
                self.order_accepted = False
                self._freeze(RampFault.REFUSED)
                return
        self._pulses_changed = True
        self.outputs = order.outputs
        self.position = tuple(start[i] if fresh >> i & 1 else self.position[i] for i in range(n))
        onward = move(start, target, tuple(max(1, s) for s in order.stride[:n]), order.pace)
        self._way = way.branch(order.branch_at if way.parts else 0, onward)

    # ---- frames to the board

    def _next_frame(self) -> bytes:
        self._seq = (self._seq + 1) & 0xFF
        match self.link:
            case LinkState.GREETING:
                frame = protocol.hello(self._seq)
            case LinkState.READING:
                frame = protocol.read(self._seq, self._channels)
            case LinkState.SETTING_UP:
                frame = protocol.setup(self._seq, self._board.prescale, self._board.silence_ms)
            case _:
                idle = not self.outputs and self._pulses_confirmed and not self._pulses_changed
                frame = protocol.hello(self._seq) if idle else self._pulse_frame()
        self.sent += 1
        return encode(frame)

    def _pulse_frame(self) -> Frame:
        if self._pulses_confirmed and self.moving:
            self.position, self._pulses_changed = self._way.at(self.remaining - 1), True
            self._way = self._way.step()
        if self._pulses_changed:
            self._pulses_changed, self._pulses_confirmed, self._first_seq = False, False, self._seq
        counts = self._board.counts(self.outputs, self.position)
        return Frame(FrameType.ARM, self._seq, self._mask, tuple(counts[i] for i in self._by_channel))

    def report(
        self, tick: int, time: int, skipped: int, max_late_ns: int, starts: int, realtime: bool, port_error: int = 0
    ) -> RampReport:
        """The report to the API process after a tick; the arguments are those of the process around this core."""
        return RampReport(
            tick, time, self.order, self.fault_count, self.sent, self.acknowledged, self.bad_frames, self.board_errors,
            self.reconnects, skipped, max_late_ns, starts, self.remaining, self.outputs, self.board_outputs, self.boot,
            port_error, self.other_version, self.link, self.fault, self.moving, self.order_accepted, realtime,
            self.position, self.register,
        )  # fmt: skip
