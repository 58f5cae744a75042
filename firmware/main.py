"""Hardware layer for a Raspberry Pi Pico with a PCA9685: pins, I2C, USB and watchdog. MicroPython only."""

import os
import select
import sys
import time

import machine
import micropython
from board import Board

SDA, SCL, OUTPUT_ENABLE, SERVICE = 4, 5, 6, 22
BUS_HZ, BUS_TIMEOUT_US = 400_000, 10_000
ADDRESS = 0x40
# Longer than the 500 ms that a write to a USB host that does not read may take.
WATCHDOG_MS = 2_000
BURST = 64


class Chip:
    """The PCA9685 on the I2C bus, and its output-enable pin, which is active low."""

    def __init__(self):
        self._disable = machine.Pin(OUTPUT_ENABLE, machine.Pin.OUT, value=1)
        self._bus = machine.I2C(0, sda=machine.Pin(SDA), scl=machine.Pin(SCL), freq=BUS_HZ, timeout=BUS_TIMEOUT_US)

    def write(self, register, data):
        self._bus.writeto_mem(ADDRESS, register, data)

    def read(self, register, length):
        return self._bus.readfrom_mem(ADDRESS, register, length)

    def enable(self, on):
        self._disable.value(not on)

    def pause_us(self, us):
        time.sleep_us(us)


def received(poll):
    """Bytes waiting on the USB port, at most `BURST`; one at a time, since larger reads block."""
    data = bytearray()
    while len(data) < BURST and poll.poll(0):
        data += sys.stdin.buffer.read(1)
    return data


def serve(board, watchdog):
    """Main loop: frames in, replies out."""
    readable, writable = select.poll(), select.poll()
    readable.register(sys.stdin, select.POLLIN)
    writable.register(sys.stdout, select.POLLOUT)
    last = time.ticks_ms()
    while True:
        now = time.ticks_ms()
        board.tick(time.ticks_diff(now, last))
        last = now
        reply = board.receive(received(readable))
        # A host that does not read gets no reply: waiting for it would delay the stop on silence.
        if reply and writable.poll(0):
            sys.stdout.buffer.write(reply)
        watchdog.feed()


def main():
    board = Board(Chip(), 1 + int.from_bytes(os.urandom(4), "little") % 0xFFFF)
    # Held low at power-on, this pin leaves the outputs off and the prompt to whoever wants to flash.
    if not machine.Pin(SERVICE, machine.Pin.IN, machine.Pin.PULL_UP).value():
        return
    micropython.kbd_intr(-1)
    try:
        serve(board, machine.WDT(timeout=WATCHDOG_MS))
    finally:
        board.stop()
        machine.reset()


main()
