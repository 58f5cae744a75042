"""State as text for a terminal. Colour only underlines what the words say."""

from __future__ import annotations

import math
import os
import sys
import time

from lrmd.messages import Event, FaultsState, InfoState, JointsState, MetricsState, ModeState, ThermalState

_COLOURS = {"red": "31", "green": "32", "yellow": "33", "bold": "1", "dim": "2"}
_OF_MODE = {
    "fault": "red",
    "estop": "red",
    "moving": "yellow",
    "arming": "yellow",
    "armed": "green",
    "holding": "green",
}
_OF_LEVEL = {"error": "red", "warning": "yellow", "hot": "red", "too_hot": "red", "warm": "yellow"}


def paint(text: str, colour: str | None) -> str:
    """Text in a colour, if it goes to a terminal and NO_COLOR is not set."""
    if colour is None or not sys.stdout.isatty() or os.environ.get("NO_COLOR"):
        return text
    return f"\033[{_COLOURS[colour]}m{text}\033[0m"


def joints_table(joints: JointsState, heat: ThermalState) -> str:
    """One line per servo."""
    head = f"{'servo':<10}{'angle':>9}{'target':>9}{'pulse':>10}{'pulses':>8}{'torque':>10}{'winding':>10}"
    unit = f"{'':<10}{'deg':>9}{'deg':>9}{'us':>10}{'':>8}{'Nm':>10}{'degC':>10}"
    lines = [paint(head, "bold"), paint(unit, "dim")]
    for i, name in enumerate(joints.names):
        known = joints.pulse_us[i] > 0
        angle = f"{math.degrees(joints.q_rad[i]):9.2f}" if known else f"{'unknown':>9}"
        target = f"{math.degrees(joints.target_rad[i]):9.2f}" if known else f"{'':>9}"
        pulse = f"{joints.pulse_us[i]:10.1f}" if known else f"{'':>10}"
        on = "on" if joints.on[i] else "off"
        level = heat.level[i]
        warmth = f"{heat.temperature_c[i]:10.1f}" + ("" if level == "cool" else f" {level}")
        warmth = paint(warmth, _OF_LEVEL.get(level))
        lines.append(f"{name:<10}{angle}{target}{pulse}{on:>8}{heat.tau_nm[i]:10.3f}{warmth}")
    return "\n".join(lines)


def mode_line(mode: ModeState, joints: JointsState) -> str:
    """What the daemon is at, in one line."""
    rest = f", {joints.remaining_s:.1f} s to go" if joints.moving else ""
    holder = f", lease: {mode.holder}" if mode.holder else ""
    link = "" if mode.link == "ready" else f", link {mode.link}"
    return f"{paint(mode.mode, _OF_MODE.get(mode.mode))} ({mode.why}{rest}){holder}{link}"


def faults_text(faults: FaultsState) -> str:
    """One line per fault that was not reset."""
    now = time.monotonic_ns()
    ages = [(fault, max(0.0, (now - fault.since_mono_ns) / 1e9)) for fault in faults.faults]
    return "\n".join(paint(f"fault {f.code}: {f.text} ({age:.0f} s ago)", "red") for f, age in ages)


def metrics_line(m: MetricsState) -> str:
    """How well the ramp keeps its time."""
    scheduling = "SCHED_FIFO" if m.realtime else "ordinary scheduling"
    return (
        f"ramp: {m.ticks} ticks, {m.skipped} skipped, late p50 {m.late_p50_us:.0f}, p99 {m.late_p99_us:.0f}, "
        f"p99.9 {m.late_p999_us:.0f}, max {m.late_max_us:.0f} us ({scheduling}); frames {m.frames_sent} sent, "
        f"{m.frames_acknowledged} acknowledged, {m.bad_frames} bad, {m.board_errors} refused; "
        f"reconnects {m.reconnects}, starts: ramp {m.ramp_starts}, ik {m.ik_starts}"
    )


def info_text(info: InfoState) -> str:
    """Who this is."""
    model = info.model or "nominal"
    lines = [
        f"{info.robot}: arm {info.arm}, lrm-arm {info.version}, tick {info.tick_ms:g} ms, model {model}",
        paint(f"{'servo':<10}{'limits':>18}{'fastest':>12}", "bold"),
    ]
    for name, (low, high), rate in zip(info.names, info.limits_rad, info.rate_rad_per_s, strict=True):
        limits = f"{math.degrees(low):.0f} .. {math.degrees(high):.0f} deg"
        lines.append(f"{name:<10}{limits:>18}{math.degrees(rate):>6.1f} deg/s")
    if info.stored_rad:
        pose = ", ".join(f"{n} {math.degrees(q):.1f}" for n, q in info.stored_rad.items())
        lines.append(f"last pose (deg): {pose}{'' if info.stored_still else '; it was moving then'}")
    return "\n".join(lines)


def event_line(event: Event) -> str:
    """One event with its local time."""
    seconds, rest = divmod(event.t_wall_ns, 10**9)
    clock = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))
    return paint(
        f"{clock}.{rest // 10**6:03d} {event.level:<8}{event.code:<18}{event.text}", _OF_LEVEL.get(event.level)
    )
