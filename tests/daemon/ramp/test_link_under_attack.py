"""The link with a man in the middle, by random sequences: laws read from the frames that reach the board.

He delays, loses and doubles frames in either direction; towards the daemon he also swaps them, replays old ones and
forges new ones with any number that no waiting frame has. With the number of one that waits he can do what the board
can (see docs/protocol.md), and towards the board whatever the daemon can: there he forges nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from lrmd.config import Config, load_config
from lrmd.link import protocol
from lrmd.link.frames import Frame, FrameDecoder, FrameType, encode
from lrmd.link.protocol import BoardInfo, BoardStatus, ErrorCode
from lrmd.ramp.shared_memory import HOLD_PULSE, LinkState, RampOrder
from tests.support.daemon.in_memory_daemon import CONFIG
from tests.support.daemon.ramp_with_board import MIDDLE, TICK, RampWithBoard

SERVOS = 0b11
SEQ, BOOT = st.integers(0, 255), st.integers(1, 65535)
STATUS = st.integers(0, 15).map(BoardStatus)
COUNTS = st.lists(st.integers(0, 4095), min_size=9, max_size=9).map(lambda counts: dict(enumerate(counts)))
FORGED = st.one_of(
    st.builds(protocol.ack, SEQ, STATUS, BOOT),
    st.builds(protocol.error, SEQ, st.sampled_from(ErrorCode), st.integers(0, 15)),
    st.builds(protocol.state, SEQ, COUNTS),
    st.builds(protocol.info, SEQ, st.builds(
        BoardInfo, st.just(1), BOOT, STATUS, st.sampled_from((121, 30)), st.sampled_from((1000, 500)),
        st.just(0), st.just(0), st.just(1),
    )),
)  # fmt: skip


def frames(wire: bytes) -> list[Frame]:
    """The whole frames in some bytes."""
    return [event for event in FrameDecoder().feed(wire) if isinstance(event, Frame)]


class LinkUnderAttack(RuleBasedStateMachine):
    """A ramp that is ordered to move, its board, and him."""

    def __init__(self) -> None:
        super().__init__()
        self.config: Config = load_config(CONFIG)
        self.line = RampWithBoard(self.config)
        self.line.board.listener = self.reached
        self.pulses: dict[int, int] = {}
        self.steps: list[int] = []
        self.order: RampOrder | None = None
        self.to_board: list[bytes] = []
        self.to_daemon: list[bytes] = []
        self.heard: list[Frame] = []
        self.waiting: list[int] = []  # numbers of the frames sent since the last one whose answer arrived
        self.held_in = self.held_out = self.lost_in = self.lost_out = 0
        self.copies_in = self.copies_out = 1
        self.swapped = False
        self.between: list[Frame] = []
        self.read_since: list[dict[int, int]] = []

    def reached(self, _: int, event: str, words: Mapping[int, int]) -> None:
        """A frame that the board carries out."""
        if event in ("silence", "power"):
            self.pulses.clear()
        if event != "arm":
            return
        for channel, count in words.items():
            before = self.pulses.pop(channel, 0)
            if count:
                self.pulses[channel] = count
                self.steps += [abs(count - before)] if before else []

    @initialize()
    def start(self) -> None:
        self.run(5)
        assert self.line.ramp.link is LinkState.READY
        self.move(0)

    # ---- one tick, with what he does in it

    def tick(self, pause: int = TICK, estop: bool = False) -> None:
        line = self.line
        foreign = [f for f in self.between if f.seq not in self.waiting]
        due = [] if self.held_out else self.to_daemon
        self.to_daemon = self.to_daemon if self.held_out else []
        due = due[::-1] if self.swapped else due
        self.swapped, self.between = False, []
        before = line.ramp.link
        line.now += pause
        line.board.tick(line.now)
        received = b"".join([*map(encode, foreign), *due])
        order = self.order and replace(self.order, heartbeat=line.now)
        out = line.ramp.tick(line.now, line.now, order, received, estop)
        arrived = [self.waiting.index(f.seq) for f in frames(b"".join(due)) if f.seq in self.waiting]
        self.waiting = self.waiting[max(arrived) + 1 :] if arrived else self.waiting
        self.waiting += [f.seq for f in frames(out)]
        self.adopted_what_was_there(before, out)
        self.towards_board(out)
        self.held_in, self.held_out = max(0, self.held_in - 1), max(0, self.held_out - 1)

    def towards_board(self, out: bytes) -> None:
        if self.lost_in:
            self.lost_in -= 1
        else:
            self.to_board += [out] * self.copies_in
        if not self.held_in:
            for wire in self.to_board:
                self.back(self.line.board.feed(wire, self.line.now))
                self.read_since += [dict(self.pulses)]
            self.to_board = []

    def back(self, wire: bytes) -> None:
        self.heard += frames(wire)
        if self.lost_out:
            self.lost_out -= 1
        else:
            self.to_daemon += [wire] * self.copies_out

    def adopted_what_was_there(self, before: LinkState, out: bytes) -> None:
        """What was adopted the board had since the first READ of this handshake; nothing if `out` ends all pulses."""
        line = self.line
        if before is not LinkState.READING and line.ramp.link is LinkState.READING:
            self.read_since = [dict(self.pulses)]
        if before is LinkState.READING and line.ramp.link is LinkState.READY:
            counts = self.config.clock.count_s * 1e9
            read = {i: round(p / counts) for i, p in enumerate(line.ramp.register) if line.ramp.board_outputs >> i & 1}
            ends_all = [(f.type, any(f.words)) for f in frames(out)] == [(FrameType.ARM, False)]
            assert read in ([{}] if ends_all else self.read_since)

    # ---- what he does

    @rule(ticks=st.integers(1, 30))
    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.tick()

    @rule(steps=st.integers(-100, 100))
    def move(self, steps: int) -> None:
        """A new order, at the pulses that the ramp has."""
        ramp = self.line.ramp
        pose = tuple(p or MIDDLE for p in ramp.position) + (0,) * 7
        goal = (MIDDLE + 1000 * steps,) * 2 + (HOLD_PULSE,) * 14
        number = 1 + (self.order.number if self.order else 0)
        self.order = self.line.order(number, outputs=SERVOS, pose=pose, target=goal)
        self.tick()

    @rule()
    def emergency_stop(self) -> None:
        self.tick(estop=True)

    @rule(ticks=st.integers(1, 30), inwards=st.booleans())
    def hold_back(self, ticks: int, inwards: bool) -> None:
        """Then all of them arrive at once."""
        self.held_in, self.held_out = (ticks, self.held_out) if inwards else (self.held_in, ticks)

    @rule(count=st.integers(1, 30), inwards=st.booleans())
    def lose(self, count: int, inwards: bool) -> None:
        self.lost_in, self.lost_out = (count, self.lost_out) if inwards else (self.lost_in, count)

    @rule(inwards=st.integers(1, 3), outwards=st.integers(1, 3))
    def double(self, inwards: int, outwards: int) -> None:
        self.copies_in, self.copies_out = inwards, outwards

    @rule(ticks=st.integers(2, 5))
    def swap(self, ticks: int) -> None:
        self.held_out = ticks
        self.run(ticks)
        self.swapped = True
        self.tick()

    @rule(ms=st.integers(7, 600))
    def late_tick(self, ms: int) -> None:
        self.tick(pause=ms * 1_000_000)

    @rule(which=st.lists(st.integers(0, 999), min_size=1, max_size=20), ticks=st.integers(1, 10))
    def replay(self, which: list[int], ticks: int) -> None:
        for _ in range(ticks):
            self.between = [self.heard[i % len(self.heard)] for i in which]
            self.tick()

    @rule(registers=st.booleans(), ticks=st.integers(1, 40))
    def replay_of_one_type(self, registers: bool, ticks: int) -> None:
        """Replays the handshake, all at once, where it is repeated."""
        kind = FrameType.STATE if registers else FrameType.INFO
        self.lost_out = 20
        for _ in range(ticks):
            self.between = [f for f in self.heard if f.type == kind]
            self.tick()

    @rule(forged=st.lists(FORGED, min_size=1, max_size=5))
    def forge(self, forged: list[Frame]) -> None:
        self.between = forged
        self.tick()

    @rule(share=st.floats(0.0, 1.0))
    def board_dies(self, share: float) -> None:
        """It says nothing any more; a part of all that it ever said is replayed in each tick."""
        self.run(2)
        self.held_in = self.held_out = 0
        self.to_daemon, ready = [], self.line.ramp.link is LinkState.READY
        for _ in range(-(-self.config.reply // TICK) + 2):
            self.lost_in, self.to_daemon = 1, []
            self.between = self.heard[: round(share * len(self.heard))]
            self.tick()
            ready = ready and self.line.ramp.link is LinkState.READY
        assert not ready, "a dead board is declared lost"
        self.lost_in = 0

    # ---- the laws

    @invariant()
    def no_pulse_jumps(self) -> None:
        count = self.config.clock.count_s * 1e9
        assert max(self.steps, default=0) * count <= self.config.step + count
        self.steps = []


TestLinkUnderAttack = LinkUnderAttack.TestCase
TestLinkUnderAttack.settings = settings(
    max_examples=25, stateful_step_count=20, deadline=None, suppress_health_check=list(HealthCheck)
)
