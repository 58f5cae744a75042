"""Attacks on the servo link, frame by frame.

Towards the board frames are garbled, doubled, delayed in order and lost, but not forged: the link has a checksum, no
key, so whoever can write frames of their own to the board moves the arm. Towards the daemon they are forged as well.
"""

from __future__ import annotations

import random
from collections import deque
from dataclasses import dataclass, field

from lrmd.link import protocol
from lrmd.link.frames import Frame, FrameType, encode
from lrmd.link.protocol import BoardStatus, ErrorCode
from tests.soak.fuzz_link import damaged
from tests.soak.hostile.link_proxy import Delayed, LinkAttack


class TowardsDaemon:
    """An attack that passes on to the board what it gets."""

    def to_board(self, wire: bytes, rng: random.Random) -> Delayed:
        return [(0.0, wire)]


@dataclass
class Garbled:
    """Flipped bits, insertions, losses within frames, in both directions."""

    share: float = 0.2

    def to_board(self, wire: bytes, rng: random.Random) -> Delayed:
        return [(0.0, damaged(wire, rng) if rng.random() < self.share else wire)]

    to_daemon = to_board


@dataclass
class Duplicated:
    """Every other frame arrives two or three times."""

    def to_board(self, wire: bytes, rng: random.Random) -> Delayed:
        return [(0.0, wire)] * rng.choice((1, 2, 3))

    to_daemon = to_board


@dataclass
class Late:
    """Frames come late by up to 80 ms, and then several at once."""

    longest: float = 0.08

    def to_board(self, wire: bytes, rng: random.Random) -> Delayed:
        return [(rng.uniform(0.0, self.longest) if rng.random() < 0.1 else 0.0, wire)]

    to_daemon = to_board


@dataclass
class Stale(TowardsDaemon):
    """Answers of the board are repeated seconds later, those of old handshakes among them."""

    heard: deque[bytes] = field(default_factory=lambda: deque(maxlen=500))

    def to_daemon(self, wire: bytes, rng: random.Random) -> Delayed:
        old = rng.choice(self.heard) if self.heard and rng.random() < 0.3 else b""
        self.heard.append(wire)
        return [(0.0, wire), (0.0, old)]


@dataclass
class Forged(TowardsDaemon):
    """Acknowledgements, errors and greetings of the board that it never sent, with correct checksums."""

    def to_daemon(self, wire: bytes, rng: random.Random) -> Delayed:
        return [(0.0, wire), (0.0, encode(_forged(rng)) if rng.random() < 0.2 else b"")]


def _forged(rng: random.Random) -> Frame:
    seq = rng.randrange(256)
    match rng.randrange(8):
        case 0:
            return protocol.error(seq, rng.choice(tuple(ErrorCode)), rng.randrange(16))
        case 1:
            info = protocol.BoardInfo(1, rng.randint(1, 65535), BoardStatus(rng.randrange(16)), 121, 1000, 0, 0, 1)
            return protocol.info(seq, info)
        case 2:
            return Frame(FrameType.INFO, seq, 0b1, (rng.randint(2, 9),))
    return protocol.ack(seq, BoardStatus.PULSING | BoardStatus.SET_UP, rng.choice((1, rng.randint(1, 65535))))


@dataclass
class Mute:
    """Nothing passes, in one direction or in both."""

    board: bool = True
    daemon: bool = True

    def to_board(self, wire: bytes, rng: random.Random) -> Delayed:
        return [] if self.board else [(0.0, wire)]

    def to_daemon(self, wire: bytes, rng: random.Random) -> Delayed:
        return [] if self.daemon else [(0.0, wire)]


@dataclass
class Hidden(TowardsDaemon):
    """The board is not heard; in place of all that it says comes the first acknowledgement that it sent."""

    acknowledged: bytes = b""

    def to_daemon(self, wire: bytes, rng: random.Random) -> Delayed:
        if not self.acknowledged and wire[1:2] == bytes([FrameType.ACK]):
            self.acknowledged = wire
        return [(0.0, self.acknowledged)]


@dataclass
class OldHandshake(TowardsDaemon):
    """Every STATE and INFO comes together with the first one of its kind, in the same moment and before it."""

    first: dict[bytes, bytes] = field(default_factory=dict)

    def to_daemon(self, wire: bytes, rng: random.Random) -> Delayed:
        if wire[1:2] not in (bytes([FrameType.STATE]), bytes([FrameType.INFO])):
            return [(0.0, wire)]
        return [(0.0, self.first.setdefault(wire[1:2], wire)), (0.0, wire)]


ATTACKS: dict[str, LinkAttack] = {
    "garbled": Garbled(), "duplicated": Duplicated(), "late": Late(), "stale": Stale(), "forged": Forged(),
    "deaf board": Mute(daemon=False), "mute board": Mute(board=False), "mute both": Mute(),
}  # fmt: skip
