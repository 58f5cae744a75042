"""Random and damaged bytes against the link's decoder and readers: `python -m tests.soak.fuzz_link [STRINGS] [SEED]`.

Violations are an exception other than `ProtocolError`, and a frame that comes out although no piece of the input, from
0x00 to 0x00, is byte for byte that frame. Counts how often damage passes for a frame: stuffing turns one flipped
bit into several, and those pass a checksum of 16 bits by chance.
"""

from __future__ import annotations

import random
import sys
from collections.abc import Callable

from lrmd.link import protocol
from lrmd.link.frames import BadFrame, Frame, FrameDecoder, FrameType, ProtocolError, encode
from lrmd.link.protocol import BoardStatus
from tests.soak.fuzz_result import FuzzResult

STRINGS = 1_000_000
FLIPS = (1, 2, 3, 4, 8)

READERS: dict[int, Callable[[Frame], Frame]] = {
    FrameType.ACK: lambda f: protocol.ack(f.seq, (a := protocol.ack_of(f)).status, a.boot),
    FrameType.ERROR: lambda f: protocol.error(f.seq, (e := protocol.error_of(f)).code, e.index or 0),
    FrameType.STATE: lambda f: protocol.state(f.seq, protocol.state_of(f)),
    FrameType.INFO: lambda f: protocol.info(f.seq, protocol.info_of(f)),
}
"""Decodes a frame and encodes it again: it must come out as it was."""


def summary(result: FuzzResult) -> str:
    """One line for people."""
    n = result.counts
    frames = f"{n['frames']} frames came out, {n['forged']} of them never sent"
    return f"{n['strings']} strings: {frames}; {len(result.violations)} lies"


def random_frame(rng: random.Random) -> Frame:
    """A frame that a host or a board would send."""
    kind, seq = rng.choice(tuple(FrameType)), rng.randrange(256)
    counts = {channel: rng.randrange(4096) for channel in range(16) if rng.random() < 0.6}
    match kind:
        case FrameType.ARM:
            return protocol.arm(seq, counts)
        case FrameType.SETUP:
            return protocol.setup(seq, rng.randint(3, 255), rng.randint(50, 10_000))
        case FrameType.READ:
            return protocol.read(seq, counts)
        case FrameType.HELLO:
            return protocol.hello(seq)
        case FrameType.ACK:
            return protocol.ack(seq, BoardStatus(rng.randrange(16)), rng.randint(1, 65535))
        case FrameType.ERROR:
            return protocol.error(seq, rng.choice(tuple(protocol.ErrorCode)), rng.randrange(16))
        case FrameType.STATE:
            return protocol.state(seq, counts)
    info = protocol.BoardInfo(
        1, rng.randint(1, 65535), BoardStatus(rng.randrange(16)), 121, 1000, rng.randrange(65536), 0, 0
    )
    return protocol.info(seq, info)


def flip(data: bytes, bits: int, rng: random.Random) -> bytes:
    """`data` with `bits` different bits flipped."""
    number = int.from_bytes(data, "big")
    for bit in rng.sample(range(8 * len(data)), bits):
        number ^= 1 << bit
    return number.to_bytes(len(data), "big")


def damaged(data: bytes, rng: random.Random) -> bytes:
    """`data` after one line fault: flipped bits, a loss, an insertion, an overwrite, a repeat or a 0x00."""
    at, length = rng.randrange(len(data)), rng.choice((1, 1, 1, 2, 4, 8))
    match rng.randrange(6):
        case 0:
            return flip(data, rng.choice(FLIPS), rng)
        case 1:
            return data[:at] + data[at + length :]
        case 2:
            return data[:at] + rng.randbytes(length) + data[at:]
        case 3:
            return data[:at] + rng.randbytes(length) + data[at + length :]
        case 4:
            return data[:at] + data[at : at + length] + data[at:]
    return data[:at] + b"\0" + data[at:]


def random_string(rng: random.Random, wires: list[bytes]) -> bytes:
    """Noise, or a few frames with damage."""
    if rng.random() < 0.25:
        return rng.randbytes(rng.randrange(80))
    text = b"".join(rng.choices(wires, k=rng.choice((1, 1, 2, 3))))
    for _ in range(rng.choice((1, 1, 1, 2, 5))):
        text = damaged(text, rng) if text else text
    return text


def check(text: bytes, sent: set[bytes], result: FuzzResult) -> None:
    """Decodes one string and counts what came out."""
    result.counts["strings"] += 1
    try:
        events = FrameDecoder().feed(text + b"\0")
        for event in events:
            if isinstance(event, BadFrame):
                continue
            result.counts["frames"] += 1
            wire = encode(event)
            result.counts["forged"] += wire not in sent
            if wire[:-1] not in text.split(b"\0"):
                result.violations.append(f"{text.hex()}: {event}")
            if _misread(event):
                result.violations.append(f"{text.hex()}: misread {event}")
    except Exception as error:  # every kind is a finding here
        result.violations.append(f"{text.hex()}: {error!r}")


def _misread(frame: Frame) -> bool:
    reader = READERS.get(frame.type)
    try:
        return reader is not None and reader(frame) != frame
    except ProtocolError:
        return False


def fuzz(strings: int, seed: int = 0) -> FuzzResult:
    """Random and damaged strings into the decoder and the readers."""
    rng, result = random.Random(seed), FuzzResult()
    wires = [encode(random_frame(rng)) for _ in range(2000)]
    sent = set(wires)
    for _ in range(strings):
        check(random_string(rng, wires), sent, result)
    return result


def flips(strings: int, bits: int, seed: int = 0) -> FuzzResult:
    """Frames of nine channels with exactly `bits` bits flipped, the ending 0x00 included."""
    rng, result = random.Random(seed), FuzzResult()
    for _ in range(strings):
        wire = encode(protocol.arm(rng.randrange(256), {channel: rng.randint(150, 600) for channel in range(9)}))
        check(flip(wire, bits, rng), {wire}, result)
    return result


def main(strings: int = STRINGS, seed: int = 0) -> int:
    """Prints the counts; 1 if there was a violation."""
    result = fuzz(strings, seed)
    print("random and damaged", summary(result))
    violations = result.violations
    for bits in FLIPS:
        result = flips(strings // 10, bits, seed)
        print(f"{bits} bits of an ARM turned over", summary(result))
        violations += result.violations
    print(*violations[:10], sep="\n")
    return bool(violations)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
