"""The firmware's main.py on a fake Pico."""

from __future__ import annotations

import io
import runpy
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from lrmd.link import protocol
from lrmd.link.frames import Frame, FrameDecoder, encode
from tests.support.daemon.firmware_board import FIRMWARE, MS, FakeI2cBus, firmware_module


class Pico:
    """Pico as far as main.py touches it: `LOOPS` times round of 5 ms each, then the cable is pulled."""

    LOOPS = 120

    def __init__(self, incoming: bytes, service: bool = False, host_reads: bool = True) -> None:
        self.bus, self.incoming, self.service, self.host_reads = FakeI2cBus(), incoming, service, host_reads
        self.out = io.BytesIO()
        self.pulsing: dict[int, bool] = {}
        self.disabled: list[object] = []
        self.events: list[str] = []
        self.ms = 0

    def pin(self, number: int, *_: object, value: int | None = None) -> SimpleNamespace:
        if value is not None:
            self.disabled.append(bool(value))
        return SimpleNamespace(value=lambda *v: self.disabled.append(bool(v[0])) if v else int(not self.service))

    def read(self, length: int) -> bytes:
        out, self.incoming = self.incoming[:length], self.incoming[length:]
        return out

    def feed(self) -> None:
        self.pulsing[self.ms] = bool(self.bus.pulses)
        self.ms += 5
        self.bus.now = self.ms * MS
        if len(self.pulsing) == self.LOOPS:
            raise KeyboardInterrupt

    def modules(self) -> dict[str, Any]:
        pin = type("Pin", (), {"OUT": 1, "IN": 0, "PULL_UP": 1, "__new__": lambda _, *a, **k: self.pin(*a, **k)})
        bus = SimpleNamespace(
            writeto_mem=lambda _, register, data: self.bus.write(register, data),
            readfrom_mem=lambda _, register, length: self.bus.read(register, length),
        )
        machine = SimpleNamespace(
            Pin=pin,
            I2C=lambda *_, **__: bus,
            WDT=lambda **_: SimpleNamespace(feed=self.feed),
            reset=lambda: self.events.append("reset"),
        )
        time = SimpleNamespace(
            ticks_ms=lambda: self.ms, ticks_diff=lambda a, b: a - b, sleep_us=lambda us: self.bus.pause_us(us)
        )
        poll = SimpleNamespace(register=lambda *_: None, poll=lambda _: bool(self.incoming))
        write = SimpleNamespace(register=lambda *_: None, poll=lambda _: self.host_reads)
        polls = iter((poll, write))
        select = SimpleNamespace(poll=lambda: next(polls), POLLIN=1, POLLOUT=4)
        return {
            "machine": machine,
            "micropython": SimpleNamespace(kbd_intr=lambda key: self.events.append(f"interrupt {key}")),
            "time": time,
            "select": select,
        }


def run_main(pico: Pico, monkeypatch: pytest.MonkeyPatch) -> None:
    firmware_module("board")
    with monkeypatch.context() as patch:
        for name, module in pico.modules().items():
            patch.setitem(sys.modules, name, module)
        patch.setattr(sys, "stdin", SimpleNamespace(buffer=SimpleNamespace(read=pico.read)))
        patch.setattr(sys, "stdout", SimpleNamespace(buffer=pico.out))
        runpy.run_path(str(FIRMWARE / "main.py"))


def test_main_serves_and_ends_with_outputs_off_and_a_restart(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = [protocol.hello(1), protocol.setup(2, 121, 10_000), protocol.arm(3, {0: 307})]
    pico = Pico(b"".join(map(encode, asked)))
    with pytest.raises(KeyboardInterrupt):
        run_main(pico, monkeypatch)
    answers = FrameDecoder().feed(pico.out.getvalue())
    assert [(a.type, a.seq) for a in answers if isinstance(a, Frame)] == [(0x84, 1), (0x81, 2), (0x81, 3)]
    assert pico.pulsing[(Pico.LOOPS - 1) * 5]
    assert False in pico.disabled
    assert pico.disabled[0] is pico.disabled[-1] is True
    assert pico.events == ["interrupt -1", "reset"]
    assert not pico.bus.pulses


@pytest.mark.parametrize("host_reads", [True, False])
def test_main_keeps_time_and_stops_in_silence(host_reads: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = [protocol.setup(2, 121, 500), protocol.arm(3, {0: 307})]
    pico = Pico(b"".join(map(encode, asked)), host_reads=host_reads)
    with pytest.raises(KeyboardInterrupt):
        run_main(pico, monkeypatch)
    on = [ms for ms, pulses in pico.pulsing.items() if pulses]
    assert 490 <= on[-1] - on[0] <= 500
    assert bool(pico.out.getvalue()) == host_reads


def test_service_pin_leaves_the_prompt_free_and_the_outputs_off(monkeypatch: pytest.MonkeyPatch) -> None:
    pico = Pico(encode(protocol.hello(1)), service=True)
    run_main(pico, monkeypatch)
    assert pico.events == []
    assert pico.pulsing == {}
    assert pico.out.getvalue() == b""
    assert pico.disabled[-1] is True
