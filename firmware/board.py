"""Frame handler of the servo board: chip registers, error replies, silence timeout. Specification: docs/protocol.md.

No hardware access. `Board` drives a `chip` with
    write(register, data)       one transaction; raises OSError where the chip does not answer
    read(register, length)      bytes, likewise
    enable(on)                  the chip's output-enable pin
    pause_us(us)                waits at least this long
"""

import link

MODE1, MODE2, LED0, PRESCALE, ALL_OFF_H = 0x00, 0x01, 0x06, 0xFE, 0xFD
RESTART, AUTO_INCREMENT, SLEEP = 0x80, 0x20, 0x10
TOTEM_POLE, FULL = 0x04, 0x10
OSCILLATOR_START_US = 500

COUNT_MAX = 4095
SETUP_LIMITS = ((3, 255), (50, 10000))
SILENCE_MS_DEFAULT = 1000


def channel_bytes(count):
    """ON_L, ON_H, OFF_L, OFF_H of a pulse that starts with the period; 0 = full off."""
    return bytes((0, 0, count & 0xFF, count >> 8 if count else FULL))


def count_of(data):
    """Counts of a channel from its registers, 0 = full off. Raises OSError on content not from `channel_bytes`."""
    if data[3] & FULL:
        return 0
    count = (data[3] & 0x0F) << 8 | data[2]
    if data[0] or data[1] & 0x1F or not count:
        raise OSError("registers of a channel are not a pulse of this link")
    return count


def wrong_bit(kind, mask, words):
    """Lowest bit of the mask whose word is out of range, or None."""
    for i, bit in enumerate(link.bits_of(mask)):
        if kind == link.HELLO or (kind == link.ARM and words[i] > COUNT_MAX):
            return bit
        if kind == link.SETUP:
            low, high = SETUP_LIMITS[bit] if bit < len(SETUP_LIMITS) else (1, 0)
            if not low <= words[i] <= high:
                return bit
    return None


def mask_on(mask, words):
    """Bits of the mask whose word is not 0."""
    return sum(1 << bit for bit, word in zip(link.bits_of(mask), words) if word)  # noqa: B905, no `strict` here


class Board:
    """State of the board from power-on. `boot`: random, 1 to 65535. `kind`: 0 = hardware, 1 = simulated."""

    def __init__(self, chip, boot, kind=0):
        self.chip, self.boot, self.kind = chip, boot, kind
        self.decoder = link.Decoder()
        self.silence_ms = SILENCE_MS_DEFAULT
        self.silenced = self.fault = self.set_up = False
        self.accepted = self.refused = 0
        # The chip may have gone on pulsing while this processor restarted: due for a stop until one is acknowledged.
        self.on, self.quiet_ms = 0xFFFF, self.silence_ms
        self.stop()

    def receive(self, data):
        """Handles bytes from the host; returns the reply."""
        replies = b""
        for event in self.decoder.feed(data):
            self.tick(0)
            replies += self._refuse(0, event) if isinstance(event, int) else self._answer(*event)
        return replies

    def tick(self, elapsed_ms):
        """Advances the clock; stops the pulses when the silence timeout expires, and retries a failed stop."""
        self.quiet_ms = min(self.quiet_ms + elapsed_ms, SETUP_LIMITS[1][1])
        if self.overdue and self.stop():
            # Latched: pulses come back by a SETUP only, so a host that was stopped cannot wake a sagged arm unaware.
            self.silenced, self.set_up = self.silenced or self.set_up, False

    @property
    def overdue(self):
        """Whether the silence timeout has expired with outputs on."""
        return self.on and self.quiet_ms >= self.silence_ms

    def stop(self):
        """All outputs off; before the first SETUP the chip sleeps, too. Returns whether the chip acknowledged."""
        self.chip.enable(False)
        try:
            self.chip.write(ALL_OFF_H, bytes((FULL,)))
            if not self.set_up:
                self.chip.write(MODE1, bytes((AUTO_INCREMENT | SLEEP,)))
            self.on = 0
            self.fault = False
        except OSError:
            self.fault = True
        return not self.fault

    @property
    def status(self):
        """The status word."""
        holds = self.on, self.silenced, self.fault, self.set_up
        return sum(1 << bit for bit in range(len(holds)) if holds[bit])

    def _answer(self, kind, seq, mask, words):
        if kind not in (link.ARM, link.SETUP, link.READ, link.HELLO):
            return self._refuse(seq, link.UNKNOWN_TYPE)
        wrong = wrong_bit(kind, mask, words)
        if wrong is not None:
            return self._refuse(seq, link.VALUE, wrong)
        if kind == link.ARM and not self.set_up:
            return self._refuse(seq, link.NOT_SET_UP)
        try:
            found = self._execute(kind, mask, words)
        except OSError:
            self.fault = True
            return self._refuse(seq, link.CHIP)
        self.accepted = self.accepted + 1 & 0xFFFF
        if kind == link.READ:
            return link.encode(link.STATE, seq, mask, found)
        if kind == link.HELLO:
            info = (link.VERSION, self.boot, self.status, found[0])
            info += (self.silence_ms, self.accepted, self.refused, self.kind)
            return link.encode(link.INFO, seq, 0xFF, info)
        return link.encode(link.ACK, seq, 0b11, (self.status, self.boot))

    def _execute(self, kind, mask, words):
        """Executes the frame; returns the chip's content for READ and HELLO."""
        if kind == link.READ:
            return self._read(mask)
        if kind == link.HELLO:
            return self.chip.read(PRESCALE, 1)
        (self._arm if kind == link.ARM else self._setup)(mask, words)
        return None

    def _arm(self, mask, words):
        self._require_mode1(AUTO_INCREMENT | SLEEP, AUTO_INCREMENT)
        if self.overdue:
            raise OSError("outputs that were due to stop could not be stopped")
        on = self.on & ~mask | mask_on(mask, words)
        # If the write is interrupted, the silence timeout still ends its pulses.
        self.on |= on
        self._write_channels(mask, words)
        self.on, self.quiet_ms, self.fault = on, 0, False
        self.chip.enable(bool(on))

    def _write_channels(self, mask, words):
        run, next_bit = b"", -1
        for bit, word in zip(link.bits_of(mask), words):  # noqa: B905, no `strict` here
            if bit != next_bit and run:
                self.chip.write(LED0 + 4 * next_bit - len(run), run)
                run = b""
            run += channel_bytes(word)
            next_bit = bit + 1
        if run:
            self.chip.write(LED0 + 4 * next_bit - len(run), run)

    def _setup(self, mask, words):
        if mask & 1:
            running = self.chip.read(MODE1, 1)[0] & (AUTO_INCREMENT | SLEEP) == AUTO_INCREMENT
            if not (running and self.chip.read(PRESCALE, 1)[0] == words[0]):
                self._start(words[0])
            self.set_up = True
        if mask & 2:
            self.silence_ms = words[-1]
        self.silenced = False

    def _start(self, prescale):
        if not self.stop():
            raise OSError("the chip does not answer")
        for register, byte in (
            (MODE1, AUTO_INCREMENT | SLEEP),
            (PRESCALE, prescale),
            (MODE2, TOTEM_POLE),
            (MODE1, AUTO_INCREMENT),
        ):
            self.chip.write(register, bytes((byte,)))
        self.chip.pause_us(OSCILLATOR_START_US)
        self.chip.write(MODE1, bytes((RESTART | AUTO_INCREMENT,)))
        if self.chip.read(PRESCALE, 1)[0] != prescale:
            raise OSError("the chip did not take the prescale")

    def _read(self, mask):
        self._require_mode1(AUTO_INCREMENT, AUTO_INCREMENT)
        return [count_of(self.chip.read(LED0 + 4 * bit, 4)) for bit in link.bits_of(mask)]

    def _require_mode1(self, bits, wanted):
        """Raises OSError if the chip has lost its settings and would misinterpret a write."""
        if self.chip.read(MODE1, 1)[0] & bits != wanted:
            raise OSError("the chip was reset: it needs a SETUP")

    def _refuse(self, seq, code, index=None):
        self.refused = self.refused + 1 & 0xFFFF
        if index is None:
            return link.encode(link.ERROR, seq, 0b1, (code,))
        return link.encode(link.ERROR, seq, 0b11, (code, index))
