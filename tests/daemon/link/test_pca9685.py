"""Register sequences against the chip model and the data sheet's figures; the port belongs to whoever has it open."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.servo_table import PwmClock
from lrmd.link import pca9685
from lrmd.link.pca9685 import BusPause, RegisterError, RegisterWrite
from lrmd.link.serial_port import SerialPort
from lrmd.sim.pca9685_chip import Pca9685Chip

COUNT = st.integers(0, 4095)
AFTER_START_NS = 10_000_000


def carry_out(chip: Pca9685Chip, steps: tuple[RegisterWrite | BusPause, ...], now: int) -> int:
    for step in steps:
        if isinstance(step, BusPause):
            now += round(step.seconds * 1e9)
        else:
            chip.write(step.register, step.data, now)
    return now


def started(prescale: int) -> Pca9685Chip:
    chip = Pca9685Chip()
    carry_out(chip, pca9685.start_sequence(prescale), 0)
    return chip


@given(COUNT)
def test_a_channel_comes_back_from_its_registers(count: int) -> None:
    assert pca9685.counts_of(pca9685.channel_bytes(count)) == count


@given(st.binary(min_size=4, max_size=4))
def test_registers_are_read_as_a_pulse_only_if_the_chip_puts_that_pulse_out(data: bytes) -> None:
    chip = started(30)
    chip.write(pca9685.channel_register(5), data, AFTER_START_NS)
    try:
        count = pca9685.counts_of(data)
    except RegisterError:
        assert data[3] & pca9685.FULL == 0
        return
    assert (chip.width(5) or 0) == count


@pytest.mark.slow
@given(st.dictionaries(st.integers(0, 15), COUNT), st.dictionaries(st.integers(0, 15), COUNT))
def test_writes_set_their_channels_and_no_others(before: dict[int, int], counts: dict[int, int]) -> None:
    chip = started(121)
    carry_out(chip, pca9685.channel_writes(before), AFTER_START_NS)
    carry_out(chip, pca9685.channel_writes(counts), AFTER_START_NS)
    wanted = dict.fromkeys(range(16), 0) | before | counts
    assert {channel: chip.width(channel) or 0 for channel in range(16)} == wanted


@pytest.mark.parametrize(("channels", "transactions"), [((), 0), (range(9), 1), ((0, 1, 3, 4, 15), 3), (range(16), 1)])
def test_adjacent_channels_share_a_transaction(channels: tuple[int, ...], transactions: int) -> None:
    assert len(pca9685.channel_writes(dict.fromkeys(channels, 300))) == transactions


@given(st.integers(3, 255), st.binary(min_size=64, max_size=64), st.integers(0, 255), st.integers(3, 255))
def test_start_works_from_any_state_all_outputs_off(prescale: int, leds: bytes, mode1: int, before: int) -> None:
    chip = Pca9685Chip()
    chip.write(pca9685.PRESCALE, bytes((before,)), 0)
    chip.write(pca9685.MODE1, bytes((pca9685.AUTO_INCREMENT,)), 0)
    chip.write(pca9685.LED0, leds, 0)
    chip.write(pca9685.MODE1, bytes((mode1,)), AFTER_START_NS)
    now = carry_out(chip, pca9685.start_sequence(prescale), 2 * AFTER_START_NS)
    assert pca9685.is_running(chip.read(pca9685.MODE1)[0], chip.read(pca9685.PRESCALE)[0], prescale)
    assert [chip.width(channel) for channel in range(16)] == [None] * 16
    carry_out(chip, pca9685.channel_writes({7: 1234}), now)
    assert [chip.width(channel) for channel in range(16)] == [None] * 7 + [1234] + [None] * 8


def test_every_output_is_off_before_the_period_changes() -> None:
    chip = started(121)
    carry_out(chip, pca9685.channel_writes(dict.fromkeys(range(16), 307)), AFTER_START_NS)
    for step in pca9685.start_sequence(30):
        if isinstance(step, RegisterWrite):
            chip.write(step.register, step.data, 2 * AFTER_START_NS)
        if chip.read(pca9685.PRESCALE)[0] == 30:
            break
    assert {pca9685.counts_of(chip.read(pca9685.channel_register(channel), 4)) for channel in range(16)} == {0}
    wake = RegisterWrite(pca9685.MODE1, bytes((pca9685.AUTO_INCREMENT,)))
    carry_out(chip, (wake, BusPause(1e-3)), 2 * AFTER_START_NS)
    assert [chip.width(channel) for channel in range(16)] == [None] * 16


def test_all_off_needs_no_auto_increment() -> None:
    chip = started(121)
    carry_out(chip, pca9685.channel_writes(dict.fromkeys(range(16), 307)), AFTER_START_NS)
    chip.write(pca9685.MODE1, b"\0", AFTER_START_NS)
    carry_out(chip, (pca9685.ALL_OFF,), AFTER_START_NS)
    assert [chip.width(channel) for channel in range(16)] == [None] * 16


@pytest.mark.parametrize(("mode1", "prescale"), [(0x30, 121), (0x00, 121), (0x20, 120), (0x11, 30)])
def test_a_chip_that_sleeps_or_has_another_prescale_is_not_running(mode1: int, prescale: int) -> None:
    assert not pca9685.is_running(mode1, prescale, 121)
    assert pca9685.is_running(0x20, 121, 121)


@given(st.floats(30.0, 330.0), st.floats(23e6, 27e6), st.floats(500e-6, 2500e-6))
def test_commanded_pulse_is_within_half_a_count(hz: float, oscillator: float, s: float) -> None:
    clock = PwmClock(hz, oscillator)
    chip = Pca9685Chip(oscillator)
    now = carry_out(chip, pca9685.start_sequence(clock.prescale), 0)
    carry_out(chip, pca9685.channel_writes({2: int(clock.counts_of(s))}), now)
    pulse = chip.pulse(2)
    assert abs(pulse - s) <= (0.5 + 1e-9) * clock.count_s
    assert np.isclose(chip.count_s, clock.count_s, rtol=1e-12)


@pytest.mark.parametrize(
    ("what", "says"),
    [
        (lambda: pca9685.channel_bytes(4096), "count 4096"),
        (lambda: pca9685.channel_register(16), "channel 16"),
        (lambda: pca9685.channel_writes({0: 1, 3: -1}), "count -1"),
        (lambda: pca9685.start_sequence(2), "prescale 2: the chip takes 3 to 255"),
        (lambda: pca9685.counts_of(b"\0\0\0"), "3 bytes"),
        (lambda: pca9685.counts_of(bytes((0, 0x10, 0, 0))), "00 10 00 00"),
        (lambda: pca9685.counts_of(bytes(4)), "00 00 00 00"),
    ],
)
def test_values_outside_the_registers_are_refused(what: Callable[[], object], says: str) -> None:
    with pytest.raises(RegisterError, match=says):
        what()


OPENS = """
import os, sys
if os.geteuid() == 0:
    os.setgroups([]); os.setgid(65534); os.setuid(65534)
try:
    os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
except OSError as error:
    sys.exit(error.errno)
"""
"""A program that opens a file as nobody would, and locks nothing."""


def opened_by_another(node: str) -> int:
    """Its errno; 0 if it got in."""
    return subprocess.run([sys.executable, "-c", OPENS, node], check=False).returncode


@pytest.fixture
def node() -> Iterator[str]:
    ends = os.openpty()
    name = os.ttyname(ends[1])
    os.close(ends[1])
    os.chmod(name, 0o666)
    yield name
    os.close(ends[0])


def test_while_it_is_open_nobody_else_opens_it(node: str) -> None:
    assert opened_by_another(node) == 0
    port = SerialPort(node, 115200)
    assert port.open()
    assert opened_by_another(node) == errno.EBUSY
    port.close()
    assert opened_by_another(node) == 0
    assert port.open()
    port.close()
