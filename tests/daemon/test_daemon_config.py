"""lrmd.toml and docs/daemon.md: the shipped file is valid, errors are one line, and the page agrees."""

from __future__ import annotations

import math
import os
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD
from lrm_math.errors import LrmError
from lrmd.config import load_config
from lrmd.control.state_machine import TABLE, Mode, Trigger
from lrmd.main import main
from lrmd.safety.thermal_model import ThermalModel
from tests.conftest import ROOT, TABLE_B2
from tests.support.broken_output import full_disk_file
from tests.support.daemon.in_memory_daemon import CONFIG

SHIPPED = CONFIG.read_text(encoding="utf-8")


def refusal(tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]) -> str:
    """The one line of `lrmd --check`, which ends with exit code 2."""
    path = tmp_path / "lrmd.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(LrmError):
        load_config(path)
    assert main(["--config", str(path), "--check"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    lines = said.err.splitlines()
    assert len(lines) == 1, said.err
    assert lines[0].startswith(f"lrmd: {path}: ")
    return lines[0]


def test_simulated_needs_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The shipped configuration, with its state where its user may write; without --simulated a file is asked for."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert main(["--simulated", "--check"]) == 0
    assert "lrmd.toml: in order" in capsys.readouterr().out
    assert main(["--check"]) == 2
    assert "--config FILE" in capsys.readouterr().err


def test_the_shipped_file_is_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    config = load_config(CONFIG)
    assert config.names == (*(f"joint{i}" for i in range(1, 7)), "gripper", "pan", "tilt")
    assert sorted(servo.channel for servo in config.servos) == list(range(9))
    assert config.tick == 6_500_000, "Conenna 2024, section 5.4"
    assert config.step == 1_000
    assert (config.command, config.lease) == (500_000_000, 400_000_000)
    assert config.zenoh.listen == ["tcp/127.0.0.1:7447"], "loopback unless told otherwise"
    assert main(["--config", str(CONFIG), "--check"]) == 0
    assert "in order; rover, lrm-rover" in capsys.readouterr().out


@pytest.mark.parametrize(("shaping", "pwm_hz", "oscillator_hz", "ticks"), [
    ("timed", 50.0, 25e6, 3), ("timed", 50.0, 26.4e6, 3), ("timed", 51.28, 25e6, None), ("timed", 60.0, 25e6, None),
    ("timed", 330.0, 25e6, None), ("zv", 50.0, 25e6, None), ("off", 50.0, 25e6, None),
])  # fmt: skip
def test_a_frame_is_whole_ticks_long_for_timed_moves_and_a_tick_is_never_shorter(
    tmp_path: Path, shaping: str, pwm_hz: float, oscillator_hz: float, ticks: int | None
) -> None:
    shaped = f'\n[motion]\nshaping = "{shaping}"\n\n[state]\n'
    text = SHIPPED.replace("\n[state]\n", shaped).replace("pwm_hz = 50.0", f"pwm_hz = {pwm_hz}")
    (tmp_path / "lrmd.toml").write_text(text.replace("oscillator_hz = 25.0e6", f"oscillator_hz = {oscillator_hz}"))
    config = load_config(tmp_path / "lrmd.toml")
    if ticks is None:
        assert config.tick == 6_500_000
    else:
        frame = COUNTS_PER_PERIOD * config.clock.count_s * 1e9
        assert 6_500_000 < config.tick < 1.05 * 6_500_000
        assert ticks * config.tick == pytest.approx(frame, abs=ticks)


def test_angles_and_pulses_are_each_others_inverse_within_the_limits() -> None:
    for servo in load_config(CONFIG).servos:
        low, high = sorted((servo.angle(servo.lowest), servo.angle(servo.highest)))
        for k in range(11):
            angle = low + (high - low) * k / 10
            assert servo.angle(servo.pulse_ns(angle)) == pytest.approx(angle, abs=math.radians(1e-3))
            assert servo.lowest <= servo.pulse_ns(angle) <= servo.highest


WRONG: list[tuple[str, str, str, list[str]]] = [
    ("unknown key", "baud = 115200", "bauds = 115200", ["link", "unknown key bauds", "did you mean baud?"]),
    ("unknown table", "[ramp]", "[rampe]", ["unknown key rampe", "did you mean ramp?"]),
    ("another schema", "lrm/daemon/1", "lrm/daemon/2", ["schema", "should be 'lrm/daemon/1'"]),
    ("no schema", 'schema = "lrm/daemon/1"', "", ['missing key schema; write schema = "lrm/daemon/1"']),
    ("no robot", 'robot = "rover"', "", ["missing key robot"]),
    ("robot with a wildcard", '"rover" ', '"ro/*er"', ["robot", "should", "A-Za-z0-9_-"]),
    ("no port", 'port = "/dev/lrm-arm"', "", ["link", "missing key port"]),
    ("missing joint", "[servo.joint4]\nchannel = 3", "", ["no [servo.joint4]", "every joint of lrm-rover"]),
    ("missing channel", "[servo.joint4]\nchannel = 3", "[servo.joint4]", ["servo joint4", "missing key channel"]),
    ("duplicate channel", "channel = 3", "channel = 2", ["servo joint4", "channel 2 is already that of joint3"]),
    ("channel of no chip", "channel = 3", "channel = 16", ["servo joint4", "channel = 16", "less than or equal to 15"]),
    ("unknown servo", "[servo.gripper]", "[servo.griper]", ["servo griper", "the arm file knows gripper"]),
    ("half a table", "pulse_us = [1100.0, 1500.0, 1900.0]\n[servo.tilt]", "[servo.tilt]", ["servo pan", "together"]),
    ("angles that fall", "[-45.0, 0.0, 45.0]\npulse_us", "[45.0, 0.0, -45.0]\npulse_us", ["servo pan", "must rise"]),
    ("pulses that turn", "[1100.0, 1500.0, 1900.0]\n[servo", "[1100.0, 1900.0, 1500.0]\n[servo", ["servo pan", "all"]),
    ("rest outside", "[0.0, -60.0,", "[0.0, -160.0,", ["rest_q_deg of joint2 is -160", "-100 to 100"]),
    ("rest too short", "0.0, 0.0, 0.0]   #", "0.0, 0.0]   #", ["rest_q_deg has 5 angles", "lrm-rover has 6 joints"]),
    ("heat out of order", "rest_c = 85.0", "rest_c = 96.0", ["ambient_c < derate_c < rest_c < off_c"]),
    ("unknown joint", "joint6 = 1490.0", "joint7 = 1490.0", ["unknown joint joint7", "valid: joint1"]),
    ("a lease that lasts", "lease_ms = 400", "lease_ms = 4000", ["safety", "lease_ms = 4000", "less than or equal to"]),
    ("no time to answer", "reply_ms = 490", "reply_ms = 10", ["reply_ms = 10", "twice tick_ms = 6.5"]),
    ("patience", "silence_ms = 1000", "silence_ms = 200", ["silence_ms = 200", "twice reply_ms = 490"]),
    ("a step that jumps", "step_us = 1.0", "step_us = 50.0", ["ramp", "step_us = 50.0", "less than or equal to 10"]),
    ("a text for a number", "tick_ms = 6.5", 'tick_ms = "6.5"', ["ramp", "tick_ms = '6.5'", "a valid number"]),
    ("not finite", "tick_ms = 6.5", "tick_ms = nan", ["ramp", "tick_ms = nan", "should be"]),
    ("seconds for ms", "tick_ms = 6.5", "tick_ms = 0.0065", ["tick_ms = 0.0065", "greater than or equal to 1"]),
    ("MHz for Hz", "oscillator_hz = 25.0e6", "oscillator_hz = 25.0", ["oscillator_hz = 25.0", "20000000"]),
    ("kelvin for degC", "off_c = 95.0", "off_c = 368.0", ["thermal", "off_c = 368.0", "less than or equal to 150"]),
    (
        "ms for us", "[1100.0, 1500.0, 1900.0]\n[servo", "[1.1, 1.5, 1.9]\n[servo",
        ["servo pan", "are 1.1 to 1.9 us long", "500 to 2500 us"],
    ),
    (
        "a digit too many", "1500.0, 1900.0]\n[servo", "1500.0, 19000.0]\n[servo",
        ["servo pan", "are 1100 to 19000 us long", "or above 3000"],
    ),
    ("an arm that is none", '"lrm-rover"  ', '"lrm-rovr"  ', ["arm: lrm-rovr: no such arm", "lrm-rover"]),
    ("listening without a protocol", "tcp/127", "127", ["zenoh: listen 1 = '127.0.0.1:7447'", "PROTOCOL/ADDRESS"]),
    ("a rate no chip has", "pwm_hz = 50.0", "pwm_hz = 5000.0", ["5000.0 Hz", "this board reaches"]),
    ("a rate too fast", "pwm_hz = 50.0", "pwm_hz = 500.0", ["servo joint1", "2460 us", "lower pwm_hz"]),
    ("not TOML", "[link]", "[link", ["not valid TOML", "line"]),
    ("seconds for a watchdog's ms", "command_ms = 500", "command_ms = 0.5", ["command_ms = 0.5", "or equal to 1"]),
    ("seconds for a delay's ms", "stagger_ms = 200", "stagger_ms = 0.2", ["stagger_ms = 0.2", "or equal to 1"]),
    ("metres of pulse", "step_us = 1.0", "step_us = 1e-6", ["step_us = 1e-06", "greater than or equal to 0.01"]),
    ("an empty port", '"/dev/lrm-arm"', '""', ["link", "port = ''", "should have at least 1 character"]),
    ("no directory", '"/var/lib/lrmd"', '""', ["state", "directory = ''", "should have at least 1 character"]),
    ("an impossible path", '"/var/lib/lrmd"', '"/var/\\u0000"', ["state", "directory = '/var/", "should match"]),
    ("nowhere to listen", '["tcp/127.0.0.1:7447"]', "[]", ["zenoh", "listen = []", "should have at least 1 item"]),
    ("listening without a port", "127.0.0.1:7447", "127.0.0.1", ["zenoh: listen 1 = 'tcp/127.0.0.1'", "tcp/HOST:PORT"]),
    ("a port as the host", "127.0.0.1:7447", "7447", ["zenoh: listen 1 = 'tcp/7447'", "tcp/HOST:PORT"]),
    ("IPv6 without brackets", "127.0.0.1:7447", "::1", ["zenoh: listen 1 = 'tcp/::1'", "tcp/[::1]:7447"]),
    ("no host", "127.0.0.1:7447", ":7447", ["zenoh: listen 1 = 'tcp/:7447'", "tcp/HOST:PORT"]),
    ("capitals", "tcp/127.0.0.1:7447", "TCP/127.0.0.1:7447", ["zenoh: listen 1 = 'TCP/127", "tcp/HOST:PORT"]),
    ("a port that is none", "connect = []", 'connect = ["tls/base:70000"]', ["tls/base:70000", "HOST:PORT"]),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "words"), [case[1:] for case in WRONG], ids=[case[0] for case in WRONG])
def test_an_error_is_reported_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, words: list[str]
) -> None:
    assert old in SHIPPED
    line = refusal(tmp_path, SHIPPED.replace(old, new, 1), capsys)
    for word in words:
        assert word in line, line


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7447", "tcp/localhost:7447", "tcp/[::1]:7447", "udp/[fe80::1%eth0]:7447", "tls/base.local:7447",
        "tcp/127.0.0.1:7447?prio=1#iface=lo", "unixsock-stream//run/lrmd.sock", "unixpipe//run/lrmd",
        "serial//dev/ttyUSB0#baudrate=115200", "vsock/-1:1234",
    ],
)  # fmt: skip
def test_an_endpoint_of_zenoh_is_taken(tmp_path: Path, endpoint: str) -> None:
    """Those of zenoh's other protocols have no port."""
    path = tmp_path / "lrmd.toml"
    path.write_text(SHIPPED.replace("tcp/127.0.0.1:7447", endpoint, 1), encoding="utf-8")
    assert load_config(path).zenoh.listen == [endpoint]


def test_a_check_that_cannot_be_printed_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before: a traceback, of `lrmd --check > FILE` on a full disk."""
    path = tmp_path / "lrmd.toml"
    path.write_text(SHIPPED, encoding="utf-8")
    with os.fdopen(full_disk_file(), "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert main(["--config", str(path), "--check"]) == 2
    assert capsys.readouterr().err == "lrmd: No space left on device\n"


MODELS: dict[str, tuple[str, str, str]] = {
    "of another arm": ('arm = "lrm-rover"', 'arm = "lrm-lab"', "a model of lrm-lab; this daemon drives lrm-rover"),
    "with an unknown effect": ('"compliance"]', '"magic"]', "magic"),
    "absurd": ('joint2.k_rad_per_Nm" = ', 'joint2.k_rad_per_Nm" = 50.0 # ', "does not settle"),
}


def checked(tmp_path: Path, old: str, new: str) -> int:
    path = tmp_path / "lrmd.toml"
    assert old in SHIPPED
    path.write_text(SHIPPED.replace(old, new), encoding="utf-8")
    return main(["--config", str(path), "--check"])


@pytest.mark.parametrize("what", MODELS)
def test_what_the_start_refuses_the_check_does(tmp_path: Path, capsys: pytest.CaptureFixture[str], what: str) -> None:
    old, new, words = MODELS[what]
    model = tmp_path / "model.toml"
    text = TABLE_B2.read_text(encoding="utf-8")
    model.write_text(text, encoding="utf-8")
    line = '# model = "/etc/lrm/model.toml"', f'model = "{model}"'
    assert checked(tmp_path, *line) == 0
    in_order = capsys.readouterr().out
    assert old in text
    model.write_text(text.replace(old, new), encoding="utf-8")
    assert checked(tmp_path, *line) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert said.err.startswith(f"lrmd: {model}: ")
    assert words in said.err
    assert f"model {model}" in in_order, "and it says which model is in order"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            '# model = "/etc/lrm/model.toml"',
            'model = "/nowhere/model.toml"',
            "/nowhere/model.toml: model: No such file",
        ),
        ('# config = "/etc/lrm/zenoh.json5"', 'config = "/nowhere/z.json5"', "/nowhere/z.json5: zenoh config: no such"),
        ('"tcp/127.0.0.1:7447"', '"nonsense"', "zenoh: listen 1 = 'nonsense'; should be PROTOCOL/ADDRESS"),
    ],
)
def test_a_file_that_the_start_would_miss_is_missed_by_the_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, words: str
) -> None:
    assert checked(tmp_path, old, new) == 2
    said = capsys.readouterr()
    assert (said.out, len(said.err.splitlines())) == ("", 1)
    assert words in said.err


@pytest.mark.parametrize("text", ['{ mode: "rou', "{ modde: 1 }"])
def test_zenohs_own_words_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str) -> None:
    beside = tmp_path / "z.json5"
    beside.write_text(text)
    assert checked(tmp_path, '# config = "/etc/lrm/zenoh.json5"', f'config = "{beside}"') == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"lrmd: {beside}: zenoh config: zenoh cannot read it; ")
    assert ".cargo" not in line
    assert len(line) < len(str(beside)) + 300


def test_a_missing_arm_file_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "lrmd.toml"
    path.write_text(SHIPPED.replace('"lrm-rover"', '"lrm-rovr"'), encoding="utf-8")
    assert main(["--config", str(path), "--check"]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert "lrm-rovr" in said
    assert "lrm-rover" in said, "the valid ones are named"


def test_a_missing_file_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--config", str(tmp_path / "none.toml"), "--check"]) == 2
    assert capsys.readouterr().err == f"lrmd: {tmp_path / 'none.toml'}: no such file\n"


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
    rows = [row for _, found in tables("guarantee", text) for row in found]
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
