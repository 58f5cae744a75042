"""Link protocol: frames round-trip, damage is confined to the frames it hits, invalid content is rejected."""

from __future__ import annotations

import random
import tracemalloc
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.errors import LrmError
from lrmd.link import protocol
from lrmd.link.frames import (
    LONGEST_FRAME,
    LONGEST_PAYLOAD,
    LONGEST_WIRE,
    WITHOUT_WORDS,
    BadFrame,
    BadFrameReason,
    Frame,
    FrameDecoder,
    FrameType,
    ProtocolError,
    bits_of,
    cobs_decode,
    cobs_encode,
    crc16,
    encode,
    word_count,
)
from tests.soak.fuzz_link import READERS, flip, flips, fuzz

WORD = st.integers(0, 0xFFFF)
BYTE = st.integers(0, 0xFF)


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    kind, mask = draw(st.sampled_from(tuple(FrameType)) | BYTE), draw(WORD)
    count = word_count(kind, mask)
    return Frame(kind, draw(BYTE), mask, tuple(draw(st.lists(WORD, min_size=count, max_size=count))))


def stuffed_by_the_book(payload: bytes) -> bytes:
    """Reference COBS encoder, bytewise as published."""
    out, run = b"", b""
    for byte in payload + b"\0":
        if byte:
            run += bytes((byte,))
        else:
            out, run = out + bytes((len(run) + 1,)) + run, b""
    return out


def crc_bit_by_bit(data: bytes) -> int:
    """Reference CRC-16/CCITT-FALSE by polynomial division."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


def subsequence(part: list[Frame], whole: list[Frame | BadFrame]) -> bool:
    rest = iter(whole)
    return all(frame in rest for frame in part)


@given(st.binary(max_size=LONGEST_PAYLOAD))
def test_stuffing_and_checksum_are_the_published_ones(payload: bytes) -> None:
    assert cobs_encode(payload) == stuffed_by_the_book(payload)
    assert crc16(payload) == crc_bit_by_bit(payload)


def test_checksum_of_the_catalogue() -> None:
    assert crc16(b"123456789") == 0x29B1


@given(st.binary(max_size=LONGEST_PAYLOAD))
def test_cobs_round_trip_without_zeros(payload: bytes) -> None:
    wire = cobs_encode(payload)
    assert cobs_decode(wire) == payload
    assert 0 not in wire
    assert len(wire) == len(payload) + 1


@given(st.binary(max_size=60) | st.lists(st.integers(0, 8), max_size=20).map(bytes))
def test_cobs_decoding_is_injective(wire: bytes) -> None:
    payload = cobs_decode(wire)
    assert payload is None or cobs_encode(payload) == wire


def test_a_payload_too_long_to_stuff_by_one_byte_is_refused() -> None:
    with pytest.raises(LrmError, match="at most 253"):
        cobs_encode(bytes(LONGEST_PAYLOAD + 1))
    assert cobs_decode(b"\xff" + b"x" * 254) is None


@pytest.mark.slow
@given(frames())
def test_every_frame_survives_the_wire(frame: Frame) -> None:
    wire = encode(frame)
    assert FrameDecoder().feed(wire) == [frame]
    assert wire.index(0) == len(wire) - 1 <= LONGEST_WIRE


@pytest.mark.slow
@given(st.lists(frames() | st.binary(max_size=90), max_size=8), st.data())
def test_decoding_is_independent_of_chunking(parts: list[Frame | bytes], data: st.DataObject) -> None:
    stream = b"".join(encode(part) if isinstance(part, Frame) else part for part in parts)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    decoder, events = FrameDecoder(), []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        events += decoder.feed(stream[start:end])
    one_by_one = FrameDecoder()
    assert events == FrameDecoder().feed(stream)
    assert events == [event for byte in stream for event in one_by_one.feed(bytes((byte,)))]


@given(st.lists(frames(), min_size=1, max_size=5), st.binary(max_size=120), st.data())
def test_inserted_bytes_cost_two_frames_at_most(sent: list[Frame], garbage: bytes, data: st.DataObject) -> None:
    hit = data.draw(st.integers(0, len(sent) - 1))
    wire = encode(sent[hit])
    at = data.draw(st.integers(0, len(wire)))
    stream = [encode(frame) for frame in sent]
    stream[hit] = wire[:at] + garbage + wire[at:]
    got = FrameDecoder().feed(b"".join(stream))
    assert subsequence(sent[:hit] + sent[hit + 2 :], got)
    if at == len(wire) and not garbage.rstrip(b"\0"):
        assert [event for event in got if isinstance(event, Frame)] == sent


@pytest.mark.slow
@given(st.lists(frames(), min_size=1, max_size=5), st.data())
def test_bytes_lost_cost_the_frame_they_were_of_and_the_one_behind(sent: list[Frame], data: st.DataObject) -> None:
    hit = data.draw(st.integers(0, len(sent) - 1))
    wire = encode(sent[hit])
    start = data.draw(st.integers(0, len(wire) - 1))
    end = data.draw(st.integers(start + 1, len(wire)))
    stream = [encode(frame) for frame in sent]
    stream[hit] = wire[:start] + wire[end:]
    assert subsequence(sent[:hit] + sent[hit + 2 :], FrameDecoder().feed(b"".join(stream)))


def test_zeros_mean_nothing() -> None:
    assert FrameDecoder().feed(bytes(1000)) == []


@pytest.mark.parametrize(
    ("wire", "reason"),
    [
        (b"\x09abc\0", BadFrameReason.COBS),
        (cobs_encode(b"\x04\x01\x00\x00\x79") + b"\0", BadFrameReason.LENGTH),
        (cobs_encode(b"\x01\x01\x03\x00\x10\x00\xaa\xbb") + b"\0", BadFrameReason.LENGTH),
        (cobs_encode(b"\x04\x01\x00\x00\x01\x78") + b"\0", BadFrameReason.CRC),
        (cobs_encode(b"x" * (LONGEST_FRAME + 1)) + b"\0", BadFrameReason.TOO_LONG),
    ],
)
def test_reasons(wire: bytes, reason: BadFrameReason) -> None:
    good = protocol.hello(9)
    assert FrameDecoder().feed(wire + encode(good)) == [BadFrame(reason), good]


def test_endless_noise_is_one_event_and_no_memory() -> None:
    decoder, noise = FrameDecoder(), b"\x55" * 4096
    events = decoder.feed(noise)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(500):
        events += decoder.feed(noise)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert events == [BadFrame(BadFrameReason.TOO_LONG)]
    assert grown < 4096
    assert decoder.feed(b"\0" + encode(protocol.hello(3))) == [protocol.hello(3)]


@pytest.mark.slow
@pytest.mark.parametrize("kind", READERS)
@given(data=st.data())
def test_parsed_frames_re_encode_identically(kind: int, data: st.DataObject) -> None:
    mask = data.draw(st.sampled_from([0, 1, 3, 5, 0xFF]) | WORD)
    word = st.integers(0, 20) | st.sampled_from([30, 255, 256, 1000, 4095, 4096, 10_001]) | WORD
    words = data.draw(st.lists(word, min_size=mask.bit_count(), max_size=mask.bit_count()))
    frame = Frame(kind, 1, mask, tuple(words))
    try:
        said = READERS[kind](frame)
    except ProtocolError:
        return
    assert said == frame


@pytest.mark.parametrize("kind", READERS)
@given(frame=frames())
def test_parsers_refuse_frames_of_another_type(kind: int, frame: Frame) -> None:
    if frame.type != kind:
        with pytest.raises(ProtocolError, match="is no"):
            READERS[kind](frame)


@given(st.dictionaries(st.integers(0, 15), st.integers(0, 4095)), BYTE)
def test_arm_and_state_carry_counts(counts: dict[int, int], seq: int) -> None:
    assert protocol.arm(seq, counts).word_by_bit() == counts
    assert protocol.state_of(protocol.state(seq, counts)) == counts
    asked = protocol.read(seq, counts)
    assert (set(bits_of(asked.mask)), asked.words) == (set(counts), ())


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: protocol.arm(1, {16: 300}), "channel 16: needs to be 0 to 15"),
        (lambda: protocol.arm(1, {0: 4096}), "count 4096: needs to be 0 to 4095"),
        (lambda: protocol.arm(256, {}), "seq 256"),
        (lambda: protocol.setup(1, 2, 1000), "prescale 2: needs to be 3 to 255"),
        (lambda: protocol.setup(1, 121, 49), "49: needs to be 50 to 10000"),
        (lambda: protocol.read(1, [-1]), "channel -1"),
        (lambda: Frame(FrameType.ARM, 1, 3, (1,)), "1 words, not 2"),
        (lambda: Frame(FrameType.READ, 1, 3, (1, 2)), "2 words, not 0"),
        (lambda: Frame(FrameType.ARM, 1, 1, (65536,)), "16 bits"),
        (lambda: Frame(300, 1, 0), "type 300"),
    ],
)
def test_impossible_frames_are_errors_that_name_the_number(make: Callable[[], Frame], says: str) -> None:
    with pytest.raises(ProtocolError, match=says):
        make()


def test_another_protocol_version_is_named() -> None:
    words = (2, 14972, 0, 30, 1000, 0, 0, 0)
    with pytest.raises(ProtocolError, match="speaks protocol 2, this software 1"):
        protocol.info_of(Frame(FrameType.INFO, 1, 0xFF, words))


def test_only_two_frame_types_have_no_words() -> None:
    assert {kind for kind in range(256) if word_count(kind, 0xFFFF) == 0} == WITHOUT_WORDS


@pytest.mark.slow
def test_noise_and_damage_are_handled_without_undetected_errors() -> None:
    result = fuzz(100_000, seed=20)
    assert result.counts["strings"] == 100_000
    assert not result.violations
    assert result.counts["frames"] > 10_000
    assert result.counts["forged"] <= 12, "damage passes far more often than a checksum of 16 bits lets it"


@pytest.mark.slow
@pytest.mark.parametrize("bits", [1, 2, 3, 8])
def test_flipped_bits_are_found_as_often_as_the_checksum_promises(bits: int) -> None:
    result = flips(10_000, bits, seed=bits)
    assert not result.violations
    assert result.counts["forged"] <= 3


def test_every_single_flipped_bit_of_a_frame_is_found() -> None:
    rng = random.Random(4)
    for _ in range(40):
        wire = encode(protocol.arm(rng.randrange(256), {channel: rng.randrange(4096) for channel in range(9)}))
        for bit in range(8 * (len(wire) - 1)):
            number = int.from_bytes(wire, "big") ^ 1 << bit + 8
            events = FrameDecoder().feed(number.to_bytes(len(wire), "big"))
            assert events
            assert all(isinstance(event, BadFrame) for event in events), wire.hex()


def test_flips_turn_over_as_many_bits_as_asked() -> None:
    data = bytes(30)
    assert int.from_bytes(flip(data, 5, random.Random(0)), "big").bit_count() == 5
