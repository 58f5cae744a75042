"""The exchange of frames with the board: which reply is one, and what it does in which state of the link.

Theory of operation. The board answers each frame once, in order, with the frame's own sequence number
(docs/protocol.md). So the frames sent are kept in order until they are answered, and a reply counts only if it is the
answer to one of them: of its number, and of the type that belongs to the frame's. Then that frame and all before it are
struck off: they were answered or lost. Hence a frame is answered at most once, and an old or repeated reply is none. A
number is given to another frame after 255 frames (1.7 s); the frame that had it is struck off then.

What the board is found to do in a handshake counts once two answers to two frames agree: a reply that is replayed fits
one frame in 255 by chance, but not two in a row.

A reply shows that the board lived when the frame was sent, however late it is read; the time without a sign of life
counts from the tick after that frame. The clock of this wait is the ramp's, but a single late tick counts at most
half of the timeout, since it may come before a reply that was in time.

`TABLE` says what a reply does. HELLO is sent while greeting, READ while reading, SETUP while setting up, ARM or HELLO
when ready; a reply that is not listed for a state changes nothing.

Here too are the facts that the ramp knows of the board and its servos: channels, limits, PWM clock and timeouts.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto

from lrmd.link import protocol
from lrmd.link.frames import Frame, FrameType
from lrmd.link.protocol import BoardInfo, BoardStatus, ErrorCode
from lrmd.ramp.shared_memory import LinkState

NUMBERS = 255
"""Sequence numbers 1 to 255; a board refuses with number 0 what it cannot read."""
ANSWER = {
    FrameType.ARM: FrameType.ACK, FrameType.SETUP: FrameType.ACK, FrameType.READ: FrameType.STATE,
    FrameType.HELLO: FrameType.INFO,
}  # fmt: skip
STRAYS = 2
"""Replies in one tick that answer nothing and repeat no answer; with more of them somebody replays a recording, of
which one may have the right number by chance: none of that tick counts."""


@dataclass(frozen=True)
class ServoOutput:
    """A servo's `channel` of the board, lowest and highest pulse (ns)."""

    channel: int
    lowest: int
    highest: int


@dataclass(frozen=True)
class BoardSettings:
    """Servos, PWM clock and limits of the board. `step`: largest pulse change per tick, ns; `count_s`: s of a count.

    `reply`: timeout, ns, of which one late tick counts at most half, since it may come before the reply.
    `pause`: ns without a frame of our own after which the handshake is repeated.
    `simulated`: the ramp's clock is not real time, so only a simulated board is accepted.
    """

    servos: tuple[ServoOutput, ...]
    prescale: int
    count_s: float
    step: int
    reply: int
    pause: int
    silence_ms: int
    simulated: bool = False

    def counts(self, outputs: int, position: Sequence[int]) -> tuple[int, ...]:
        """OFF count per servo: its pulse `position` (ns) rounded to counts, 0 where its bit of `outputs` is clear."""
        per_ns = 1e-9 / self.count_s
        return tuple(int(p * per_ns + 0.5) if outputs >> i & 1 else 0 for i, p in enumerate(position))

    def pulse(self, count: int) -> int:
        """Pulse width (ns) of a count."""
        return round(count * self.count_s * 1e9)


class BoardReply(Enum):
    """Content of the board's answer to a frame."""

    PULSES_SET = auto()
    """ACK to ARM."""
    WAS_SET_UP = auto()
    """ACK to SETUP."""
    REGISTERS = auto()
    """STATE to READ."""
    PULSING = auto()
    """INFO: it has pulses, with our settings."""
    RESTING = auto()
    """INFO: it has our settings, and no pulses."""
    BARE = auto()
    """INFO: it has neither."""
    FOREIGN = auto()
    """INFO: pulses with other settings, or in doubt after a chip fault: left to the silence timeout."""
    NOT_SET_UP = auto()
    """ERROR 5, or a status without the bit."""
    OTHER_ERROR = auto()
    """ERROR of another code: the frame had no effect."""


class Action(Enum):
    """Response of the ramp's pulses to a reply."""

    CONFIRM = auto()
    """The board has the pulses of the frame: the next step may follow."""
    ADOPT = auto()
    """Takes the board's registers over as the present position."""
    BEGIN = auto()
    """The board has no pulses: ours are off, too, until the next order."""


S, R, A = LinkState, BoardReply, Action
TABLE: dict[tuple[LinkState, BoardReply], tuple[LinkState, Action | None]] = {
    (S.GREETING, R.PULSING): (S.READING, None),
    (S.GREETING, R.RESTING): (S.READY, A.BEGIN),
    (S.GREETING, R.BARE): (S.SETTING_UP, A.BEGIN),
    (S.READING, R.REGISTERS): (S.READY, A.ADOPT),
    (S.READING, R.NOT_SET_UP): (S.GREETING, None),
    (S.SETTING_UP, R.WAS_SET_UP): (S.READY, None),
    (S.SETTING_UP, R.NOT_SET_UP): (S.GREETING, None),
    (S.READY, R.PULSES_SET): (S.READY, A.CONFIRM),
    (S.READY, R.BARE): (S.GREETING, None),
    (S.READY, R.NOT_SET_UP): (S.GREETING, None),
}
"""(state, reply): the next state, and what is done."""


@dataclass(slots=True)
class SentFrame:
    """A frame that waits for its answer. `number`: of all sent; `due`: time (ns) of the wait, at the tick after."""

    number: int
    seq: int
    type: FrameType | int
    mask: int
    due: int


class BoardLink:
    """State of the link and the frames that wait for an answer; `timeout`: of a reply, ns."""

    def __init__(self, timeout: int) -> None:
        self.state = LinkState.CLOSED
        self._timeout = timeout
        self._outstanding: deque[SentFrame] = deque(maxlen=NUMBERS)
        self._said: object = None
        self._last_sent = self._clock = self._alive = self._answered = 0

    @property
    def unanswered(self) -> int:
        """Time (ns) without a sign of life; 0 if the last frame was answered."""
        return self._clock - self._alive

    def begin(self, state: LinkState, now: int | None = None) -> None:
        """Begins anew in `state`: nothing sent before is waited for. `now`: ns, if the port was opened just now."""
        self.state, self._alive, self._said = state, self._clock, None
        self._outstanding.clear()
        self._last_sent = self._last_sent if now is None else now

    def wait(self, now: int) -> int:
        """Starts a tick at `now` (ns); returns the time since the last frame was sent."""
        since = now - self._last_sent
        self._clock += min(since, self._timeout // 2)
        if self._outstanding:
            self._outstanding[-1].due = self._clock
        return since

    def send(self, frame: Frame, number: int, now: int) -> None:
        """Notes a frame that is sent at `now` (ns), the `number`-th of all."""
        self._last_sent = now
        self._outstanding.append(SentFrame(number, frame.seq, frame.type, frame.mask, self._clock))

    def answers(self, replies: list[Frame]) -> list[tuple[Frame, SentFrame]]:
        """Replies of a tick that answer a frame, each with it."""
        answers_found, strays = [], 0
        for reply in replies:
            sent = self._strike_off(reply)
            if sent is not None:
                answers_found.append((reply, sent))
            else:
                strays += reply.seq not in (0, self._answered)
        return answers_found if strays <= STRAYS else []

    def _strike_off(self, reply: Frame) -> SentFrame | None:
        fits = (sent for sent in self._outstanding if sent.seq == reply.seq and answers(reply, sent))
        answered = next(fits, None)
        if answered is not None:
            self._answered = reply.seq
            while self._outstanding.popleft() is not answered:
                pass
        return answered

    def agrees(self, content: object) -> bool:
        """Whether an answer of the handshake says the same as the one before it, to another frame."""
        same, self._said = content == self._said, content
        return same

    def sign_of_life(self, sent: SentFrame) -> None:
        """The board lived when this frame was sent."""
        self._alive = max(self._alive, sent.due)

    def step(self, reply: BoardReply) -> Action | None:
        """Follows `TABLE`."""
        self.state, action = TABLE.get((self.state, reply), (self.state, None))
        return action


def answers(reply: Frame, sent: SentFrame) -> bool:
    """Whether a reply is of the type that answers a frame, and a STATE of the channels that were asked for."""
    asked = reply.type != FrameType.STATE or reply.mask == sent.mask
    return reply.type == FrameType.ERROR or (ANSWER[FrameType(sent.type)] == reply.type and asked)


def reply_of_ack(status: BoardStatus, sent: SentFrame) -> BoardReply:
    """Kind of an ACK."""
    if BoardStatus.SET_UP not in status:
        return BoardReply.NOT_SET_UP
    return BoardReply.WAS_SET_UP if sent.type == FrameType.SETUP else BoardReply.PULSES_SET


def reply_of_error(frame: Frame) -> BoardReply:
    """Kind of an ERROR. Raises `ProtocolError` on invalid content."""
    not_set_up = protocol.error_of(frame).code is ErrorCode.NOT_SET_UP
    return BoardReply.NOT_SET_UP if not_set_up else BoardReply.OTHER_ERROR


def reply_of_info(info: BoardInfo, board: BoardSettings) -> BoardReply:
    """Kind of an INFO, where the settings are to be those of `board`.

    The chip answered, since INFO has its prescale: a chip fault is an earlier one, which the next write that it
    acknowledges clears. Only where there are pulses it leaves in doubt which.
    """
    same = info.prescale == board.prescale and info.silence_ms == board.silence_ms
    as_wanted = same and BoardStatus.SET_UP in info.status
    if BoardStatus.PULSING in info.status:
        certain = as_wanted and BoardStatus.CHIP_FAULT not in info.status
        return BoardReply.PULSING if certain else BoardReply.FOREIGN
    return BoardReply.RESTING if as_wanted else BoardReply.BARE
