"""Sans-io core of the ramp process: per tick, received bytes and an order in; bytes to send and a report out.

Invariants for any input:
- A pulse that the board puts out changes by at most one step per tick, and only after the board acknowledged the frame
  before. So a stall or lost frames lengthen a move; they never add up to a jump.
- A servo is switched on only by a new order whose sender has seen every fault so far. No motion resumes by itself.
- A pulse outside the servo's limits is never sent.

Which replies count, and what each does, is in `lrmd.ramp.board_link`.
"""

from __future__ import annotations

from lrmd.link import protocol
from lrmd.link.frames import Frame, FrameDecoder, FrameType, ProtocolError, encode
from lrmd.link.protocol import BoardStatus
from lrmd.ramp.board_link import (
    NUMBERS,
    Action,
    BoardLink,
    BoardReply,
    BoardSettings,
    SentFrame,
    reply_of_ack,
    reply_of_error,
    reply_of_info,
)
from lrmd.ramp.shared_memory import AT_ONCE, HOLD_PULSE, LinkState, RampFault, RampOrder, RampReport
from lrmd.ramp.stepping import Way, move, valid_impulses, valid_waits

REPORTED = (
    "order", "order_accepted", "fault_count", "fault", "sent", "acknowledged", "bad_frames", "board_errors",
    "reconnects", "remaining", "outputs", "board_outputs", "boot", "other_version", "link", "moving", "position",
    "register", "turned_at",
)  # fmt: skip
"""Fields of the report that are attributes of the core."""
API_TIMEOUT = 500_000_000
"""ns without a heartbeat of the API process after which a move is frozen, and an order for pulses comes too late."""


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
        self.turned_at, self._ways = self.position, (0,) * n
        self.boot, self.order, self.order_accepted = earlier.boot, earlier.order, earlier.order_accepted
        self.fault_count, self.fault = earlier.fault_count, earlier.fault
        self.sent, self.acknowledged = earlier.sent, earlier.acknowledged
        self.bad_frames, self.board_errors = earlier.bad_frames, earlier.board_errors
        self.reconnects = earlier.reconnects
        self.other_version = 0
        self._link = BoardLink(board.reply)
        self._decoder = FrameDecoder()
        self._way = Way()
        self._first = 0  # number of the first frame with the present pulses
        self._pulses_changed, self._pulses_confirmed = False, True
        self._freeze(RampFault.STARTED)

    @property
    def link(self) -> LinkState:
        """State of the handshake with the board."""
        return self._link.state

    @property
    def moving(self) -> bool:
        """Whether a move is in progress."""
        return bool(self._way.parts)

    @property
    def standing_by(self) -> bool:
        """Whether no servo has pulses and the board replied to the last frame, so that slower ticks delay nothing."""
        resting = not self.outputs and not self.board_outputs and self._pulses_confirmed
        return resting and self.link is LinkState.READY and not self._link.unanswered

    @property
    def remaining(self) -> int:
        """Ticks left in the motion if no frame is lost."""
        return self._way.remaining

    def tick(self, now: int, alive: int, order: RampOrder | None, received: bytes | None, estop: bool) -> bytes:
        """Runs one tick at `now` (ns) and returns the bytes to send.

        `alive`: time (ns) on the clock of `order.heartbeat`. `received`: bytes from the port since the last tick, None
        while it is closed.
        """
        since = self._link.wait(now)
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
        paused = since > self._board.pause and self.link is LinkState.READY
        if paused or self._link.unanswered > self._board.reply:
            self._leave_link(LinkState.GREETING)
        return self._send(self._next_frame(), now)

    def opened(self, now: int) -> None:
        """The port was opened: restarts the handshake with HELLO."""
        self._decoder = FrameDecoder()
        self._link.begin(LinkState.GREETING, now)
        self.other_version = 0
        self.reconnects += 1

    def close(self) -> None:
        """The port was closed or lost."""
        self._leave_link(LinkState.CLOSED)

    def _leave_link(self, link: LinkState) -> None:
        """The port is gone, or a reply or our own tick came too late: the handshake is repeated before any pulse."""
        was_ready = self.link is LinkState.READY
        self._link.begin(link)
        if was_ready:
            self._freeze(RampFault.LINK_LOST)

    def _freeze(self, why: RampFault) -> None:
        self._way = Way()
        self.fault_count, self.fault = self.fault_count + 1, why

    def _stop_pulses(self, why: RampFault) -> None:
        self.outputs, self._pulses_changed, self._pulses_confirmed = 0, True, False
        self._end_others()
        self._freeze(why)

    # ---- frames from the board

    def _receive(self, data: bytes) -> None:
        events = self._decoder.feed(data)
        replies = [event for event in events if isinstance(event, Frame)]
        self.bad_frames += len(events) - len(replies)
        self.board_errors += sum(reply.type == FrameType.ERROR for reply in replies)
        for reply, sent in self._link.answers(replies):
            try:
                self._handle_answer(reply, sent)
            except protocol.OtherVersion as other:
                self.bad_frames += self.link is LinkState.READY
                self.other_version = other.version if self.link is LinkState.GREETING else self.other_version
            except ProtocolError:
                self.bad_frames += 1

    def _handle_answer(self, frame: Frame, sent: SentFrame) -> None:
        kind, counts = self._read(frame, sent)
        if kind is None:
            return
        if frame.type != FrameType.ERROR:
            self._link.sign_of_life(sent)
        self.acknowledged += kind is BoardReply.PULSES_SET
        match self._link.step(kind):
            case Action.CONFIRM:
                self._pulses_confirmed |= not self._pulses_changed and sent.number >= self._first
            case Action.ADOPT:
                self._adopt_registers(counts)
            case Action.BEGIN:
                if self.outputs:
                    self._stop_pulses(RampFault.BOARD_SILENCED)
                self._pulses_changed, self._pulses_confirmed = False, True

    def _read(self, frame: Frame, sent: SentFrame) -> tuple[BoardReply | None, dict[int, int]]:
        """The kind of an answer, and the counts of a STATE; None if it is of a board that is not ours, or if it is of a
        handshake and no other answer has said the same."""
        match frame.type:
            case FrameType.ACK:
                answer = protocol.ack_of(frame)
                self._check_board(answer.status, answer.boot)
                return reply_of_ack(answer.status, sent), {}
            case FrameType.INFO:
                info = protocol.info_of(frame)
                kind = reply_of_info(info, self._board)
                if self._board.simulated and not info.simulated:
                    return None, {}
                if self.link is LinkState.GREETING and not self._link.agrees((kind, info.boot)):
                    return None, {}
                self._check_board(info.status, info.boot)
                self.other_version = 0
                return kind, {}
            case FrameType.STATE:
                counts = protocol.state_of(frame)
                return (BoardReply.REGISTERS if self._link.agrees(counts) else None), counts
        return reply_of_error(frame), {}

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

    def _adopt_registers(self, counts: dict[int, int]) -> None:
        """Adopts the registers of a board that is still pulsing as the present position, where a motion ends."""
        if self.moving:
            self._freeze(RampFault.LINK_LOST)
        read = tuple(counts[channel] for channel in self._channels)
        self.board_outputs = sum(1 << i for i, count in enumerate(read) if count)
        self.register = tuple(self._board.pulse(count) for count in read)
        if self.outputs & ~self.board_outputs:
            self.outputs &= self.board_outputs
            self._freeze(RampFault.BOARD_SILENCED)
        ours = self._board.counts(self.outputs, self.position)
        self.position = tuple(
            p if count in (0, count_of_channel) else pulse
            for p, count_of_channel, count, pulse in zip(self.position, ours, read, self.register, strict=True)
        )
        self._pulses_changed = self._pulses_changed or bool(self.outputs)
        self._pulses_confirmed = not self._pulses_changed
        if self._pulses_changed:
            self._end_others()

    def _end_others(self) -> None:
        """A frame of pulses ends all others that the board has: what was read of those is no pose any more."""
        self.board_outputs &= self.outputs

    # ---- orders from the API process

    def _check_order(self, order: RampOrder, alive: int) -> None:
        new = order.number != self.order
        if alive - order.heartbeat > API_TIMEOUT and (self.moving or (new and order.outputs)):
            self._freeze(RampFault.API_SILENT)
        if not new:
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
        shape_fits = valid_impulses(order.impulses) and valid_waits(order.waits)
        for i, servo in enumerate(self._board.servos):
            inside = servo.lowest <= start[i] <= servo.highest and servo.lowest <= target[i] <= servo.highest
            stride_fits = 0 < order.stride[i] <= self._board.step
            if order.outputs >> i & 1 and not (inside and stride_fits and shape_fits):
                self.order_accepted = False
                self._freeze(RampFault.REFUSED)
                return
        self._pulses_changed = True
        self.outputs = order.outputs
        self._end_others()
        self.position = tuple(start[i] if fresh >> i & 1 else self.position[i] for i in range(n))
        stride = tuple(max(1, s) for s in order.stride[:n])
        onward = move(start, target, stride, order.pace, order.impulses, order.waits)
        self._way = way.branch(order.branch_at if way.parts else 0, onward)

    # ---- frames to the board

    @property
    def _seq(self) -> int:
        return self.sent % NUMBERS + 1

    def _next_frame(self) -> Frame:
        match self.link:
            case LinkState.GREETING:
                return protocol.hello(self._seq)
            case LinkState.READING:
                return protocol.read(self._seq, self._channels)
            case LinkState.SETTING_UP:
                return protocol.setup(self._seq, self._board.prescale, self._board.silence_ms)
        idle = not self.outputs and self._pulses_confirmed and not self._pulses_changed
        return protocol.hello(self._seq) if idle else self._pulse_frame()

    def _send(self, frame: Frame, now: int) -> bytes:
        self._link.send(frame, self.sent, now)
        self.sent += 1
        return encode(frame)

    def _pulse_frame(self) -> Frame:
        if self._pulses_confirmed and self.moving:
            before, self.position, self._pulses_changed = self.position, self._way.at(self.remaining - 1), True
            self._note_turns(before)
            self._way = self._way.step()
        if self._pulses_changed:
            self._pulses_changed, self._pulses_confirmed, self._first = False, False, self.sent
        counts = self._board.counts(self.outputs, self.position)
        return Frame(FrameType.ARM, self._seq, self._mask, tuple(counts[i] for i in self._by_channel))

    def _note_turns(self, before: tuple[int, ...]) -> None:
        """Notes which servos now move the other way than before their last step, from pulses `before` (ns)."""
        ways = tuple((now > then) - (now < then) for now, then in zip(self.position, before, strict=True))
        turned = tuple(way not in (0, old) for way, old in zip(ways, self._ways, strict=True))
        self.turned_at = tuple(b if t else at for b, t, at in zip(before, turned, self.turned_at, strict=True))
        self._ways = tuple(way or old for way, old in zip(ways, self._ways, strict=True))

    def report(
        self, tick: int, time: int, skipped: int, max_late_ns: int, starts: int, realtime: bool, port_error: int = 0
    ) -> RampReport:
        """The report to the API process after a tick; the arguments are those of the process around this core."""
        return RampReport(
            tick=tick, time=time, skipped=skipped, max_late_ns=max_late_ns, starts=starts, realtime=realtime,
            port_error=port_error, **{name: getattr(self, name) for name in REPORTED},
        )  # fmt: skip
