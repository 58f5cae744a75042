"""docs/daemon.md agrees with the code and the shipped configuration: state machine, numbers, temperatures."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator

import pytest

from lrmd.config import load_config
from lrmd.control.state_machine import TABLE, Mode, Trigger
from lrmd.safety.thermal_model import ThermalModel
from tests.conftest import ROOT
from tests.support.daemon.in_memory_daemon import CONFIG

TEXT = (ROOT / "docs" / "daemon.md").read_text(encoding="utf-8")


def tables(first: str, text: str = TEXT) -> Iterator[tuple[list[str], list[list[str]]]]:
    """Headings and rows of every table whose first heading is this."""
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        head, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines())
        if head[0] == first:
            yield head, rows


def test_the_table_of_modes_is_the_codes() -> None:
    documented = {
        (Mode(mode), Trigger(trigger)): Mode(to)
        for head, rows in tables("trigger")
        for trigger, *cells in rows
        for mode, to in zip(head[1:], cells, strict=True)
        if to != "–"
    }
    assert documented == TABLE
    assert [t for _, rows in tables("trigger") for t, *_ in rows] == list(Trigger), "every trigger has its row"


def test_the_picture_of_modes_is_the_codes() -> None:
    drawn = {
        (Mode(a), Trigger(trigger)): Mode(b)
        for a, b, triggers in re.findall(r"^    (\w+) --> (\w+) : (.+)$", TEXT, re.MULTILINE)
        for trigger in triggers.split(", ")
    }
    assert drawn == {(m, t): to for (m, t), to in TABLE.items() if m is not to and t is not Trigger.ESTOP}
    assert re.findall(r"\[\*\] --> (\w+)", TEXT) == [Mode.DISARMED]


def test_the_numbers_are_those_of_the_shipped_configuration() -> None:
    shipped = tomllib.loads(CONFIG.read_text(encoding="utf-8"))
    seen = 0
    for _, rows in tables("key"):
        for key, value, _ in rows:
            place = shipped
            *way, last = key.strip("`").split(".")
            for part in way:
                place = place[part]
            assert place[last] == pytest.approx(float(value)), key
            seen += 1
    assert seen >= len(shipped["thermal"]) + len(shipped["thermal"]["rise_k_per_nm2"])


def test_the_times_until_a_servo_is_warm_hot_and_too_hot_are_the_models() -> None:
    config = load_config(CONFIG)
    model = ThermalModel.of(config)
    ((_, rows),) = tables("held without a break, from cold")
    for what, *times in rows:
        joint, tau = what.removesuffix(" N·m").split(", ")
        rise = model.rise[config.index(joint)]
        for limit, documented in zip(model.limits, times, strict=True):
            seconds = model.seconds_to(limit, model.ambient, float(tau), rise)
            minutes = math.inf if documented == "never" else float(documented.removesuffix(" min"))
            assert minutes == pytest.approx(seconds / 60, abs=0.05)


@pytest.mark.parametrize("name", ["api.md", "campaign.md", "daemon.md", "protocol.md"])
def test_every_promise_names_tests_that_exist(name: str) -> None:
    text = (ROOT / "docs" / name).read_text(encoding="utf-8")
    sources = "".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "tests").rglob("test_*.py")))
    written = set(re.findall(r"^def (test_\w+)\(", sources, re.MULTILINE))
    rows = [row for _, found in tables("promise", text) for row in found]
    assert len(rows) >= 9
    for promise, tests in rows:
        named, files = re.findall(r"`(test_\w+)`", tests), re.findall(r"`(tests/[\w/]+\.py)`", tests)
        assert named or files, promise
        assert set(named) <= written, (promise, set(named) - written)
        assert all((ROOT / file).exists() for file in files), promise
    assert re.search(r"\n(\*\*)?Not tested:", text)


def test_links_lead_somewhere() -> None:
    for name in ("daemon.md", "api.md"):
        text = (ROOT / "docs" / name).read_text(encoding="utf-8")
        for link in re.findall(r"\]\(([^)#]+)", text):
            assert (ROOT / "docs" / link).exists(), (name, link)
