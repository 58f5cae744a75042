"""Formatting of the daemon's messages for a terminal; colour adds no information."""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Sequence
from itertools import pairwise

from lrmd.messages.control import (
    Event,
    FaultsState,
    FieldPart,
    InfoState,
    JointsState,
    MetricsState,
    ModeState,
    ThermalState,
)
from lrmd.messages.kinematics import FkAnswer, IkAnswer

_COLOURS = {"red": "31", "green": "32", "yellow": "33", "bold": "1", "dim": "2"}
_MODE_COLOURS = dict.fromkeys(("fault", "estop"), "red") | dict.fromkeys(("moving", "arming"), "yellow")
_MODE_COLOURS |= dict.fromkeys(("armed", "holding"), "green")
_LEVEL_COLOURS = {"error": "red", "warning": "yellow", "hot": "red", "too_hot": "red", "warm": "yellow"}

COARSE_HZ = 100.0
"""Frequency of the pulses below which `timed` leaves less swing than `zv`."""


def paint(text: str, colour: str | None) -> str:
    """ANSI-coloured text, plain if stdout is no terminal or NO_COLOR is set."""
    if colour is None or not sys.stdout.isatty() or os.environ.get("NO_COLOR"):
        return text
    return f"\033[{_COLOURS[colour]}m{text}\033[0m"


def joints_table(joints: JointsState, heat: ThermalState) -> str:
    """Table of the servos, one line each."""
    head = f"{'servo':<10}{'angle':>9}{'target':>9}{'pulse':>10}{'pulses':>8}{'torque':>10}{'winding':>10}"
    unit = f"{'':<10}{'deg':>9}{'deg':>9}{'us':>10}{'':>8}{'Nm':>10}{'degC':>10}"
    lines = [paint(head, "bold"), paint(unit, "dim")]
    for i, name in enumerate(joints.names):
        has_pulse = joints.pulse_us[i] > 0
        angle = f"{math.degrees(joints.q_rad[i]):9.2f}" if has_pulse else f"{'unknown':>9}"
        target = f"{math.degrees(joints.target_rad[i]):9.2f}" if has_pulse else f"{'':>9}"
        pulse = f"{joints.pulse_us[i]:10.1f}" if has_pulse else f"{'':>10}"
        on = "on" if joints.on[i] else "off"
        level, soon = heat.level[i], heat.hot_in_s[i]
        winding = f"{heat.temperature_c[i]:10.1f}" + ("" if level == "cool" else f" {level}")
        winding = paint(winding + (f", hot in {soon / 60:.0f} min" if soon else ""), _LEVEL_COLOURS.get(level))
        lines.append(f"{name:<10}{angle}{target}{pulse}{on:>8}{heat.tau_nm[i]:10.3f}{winding}")
    return "\n".join(lines)


def pulseless_note(joints: JointsState) -> str:
    """That servos without pulses may stand elsewhere than they were commanded last; empty where there are none."""
    pulseless = [
        name for name, on, pulse in zip(joints.names, joints.on, joints.pulse_us, strict=True) if pulse and not on
    ]
    if not pulseless:
        return ""
    return "Without pulses an arm may stand elsewhere: angles of servos that are off are the last commanded ones."


def mode_line(mode: ModeState, joints: JointsState) -> str:
    """Mode, reason, remaining time, lease and link, in one line; and what keeps the arm from being armed."""
    rest = f", {joints.remaining_s:.1f} s to go" if joints.moving else ""
    holder = f", lease: {mode.holder}" if mode.holder else ""
    link = "" if mode.link == "ready" else f", link {mode.link}"
    line = f"{paint(mode.mode, _MODE_COLOURS.get(mode.mode))} ({mode.why}{rest}){holder}{link}"
    return "\n".join([line, *(paint(trouble, "red") for trouble in mode.troubles)])


def faults_text(faults: FaultsState) -> str:
    """One line per active fault."""
    now = time.monotonic_ns()
    ages = [(fault, max(0.0, (now - fault.since_mono_ns) / 1e9)) for fault in faults.faults]
    return "\n".join(paint(f"fault {f.code}: {f.text} ({age:.0f} s ago)", "red") for f, age in ages)


def metrics_line(m: MetricsState) -> str:
    """Timing and link statistics of the ramp, in one line."""
    scheduling = "SCHED_FIFO" if m.realtime else "ordinary scheduling"
    return (
        f"ramp: {m.ticks} ticks, {m.skipped} skipped, late p50 {m.late_p50_us:.0f}, p99 {m.late_p99_us:.0f}, "
        f"p99.9 {m.late_p999_us:.0f}, max {m.late_max_us:.0f} us ({scheduling}); frames {m.frames_sent} sent, "
        f"{m.frames_acknowledged} acknowledged, {m.bad_frames} bad, {m.board_errors} refused; "
        f"reconnects {m.reconnects}, starts: ramp {m.ramp_starts}, ik {m.ik_starts}"
    )


def lateness_chart(m: MetricsState) -> str:
    """Histogram of the ramp's lateness from its first to its last non-empty bucket, one line each."""
    lows = (0.0, *m.late_upper_us)
    names = [f"{low:.0f} .. {high:.0f}" for low, high in pairwise(lows)] + [f"{lows[-1]:.0f} or more"]
    seen = [i for i, count in enumerate(m.late_counts) if count]
    lines = [paint(f"{'late':>14}{'ticks':>12}{'share':>11}  one # more: twice as many", "bold"), f"{'us':>14}"]
    for i in range(seen[0], seen[-1] + 1) if seen else ():
        count = m.late_counts[i]
        lines.append(f"{names[i]:>14}{count:>12}{count / m.ticks:>11.4%}  {'#' * count.bit_length()}".rstrip())
    return "\n".join(lines)


def info_text(info: InfoState) -> str:
    """Names, limits and rates of the servos, and the stored pose."""
    model = model_text(info.model or "nominal", info.model_sha256)
    lines = [
        f"{info.robot}: arm {info.arm}, lrm-arm {info.version}, tick {info.tick_ms:.4g} ms, {model}",
        step_text(info),
        *([motion_model_text(info.motion_model, info.motion_sha256), shaping_text(info)] if info.motion_model else []),
        paint(f"{'servo':<10}{'limits':>18}{'fastest':>12}", "bold"),
    ]
    for name, (low, high), rate in zip(info.names, info.limits_rad, info.rate_rad_per_s, strict=True):
        limits = f"{math.degrees(low):.0f} .. {math.degrees(high):.0f} deg"
        lines.append(f"{name:<10}{limits:>18}{math.degrees(rate):>6.1f} deg/s")
    if info.stored_rad:
        pose = ", ".join(f"{n} {math.degrees(q):.1f}" for n, q in info.stored_rad.items())
        lines.append(f"last pose (deg): {pose}{'' if info.stored_still else '; it moved then, or has fallen since'}")
    return "\n".join(lines)


def step_text(info: InfoState) -> str:
    """Largest change of a pulse at once: as commanded, and as the board puts it out in counts."""
    largest = math.ceil(round(info.step_us / info.count_us, 6)) * info.count_us
    return (
        f"pulses: commanded in steps of at most {info.step_us:g} us per tick;\n"
        f"put out in counts of {info.count_us:.2f} us ({info.pwm_hz:.0f} Hz), so in steps of at most {largest:.2f} us"
    )


def model_text(model: str, sha256: str) -> str:
    """Name and digest of the model."""
    return f"model {model}" + (f", sha256 {sha256[:12]}" if sha256 else "")


def motion_model_text(model: str | None, sha256: str) -> str:
    """Name and digest of the model of motion."""
    return f"motion model {model}, sha256 {sha256[:12]}" if model else "no motion model"


def shaping_text(info: InfoState) -> str:
    """Whether moves are shaped, and where that is said."""
    if info.motion_model is None:
        return "moves are not shaped, and replies have no settling time, without a motion model"
    if info.shaping == "off":
        kind = "timed" if info.pwm_hz < COARSE_HZ else "zv"
        return (
            "moves are not shaped: lrmd.toml says [motion] shaping = 'off'; a client can ask for it, move by move\n"
            f"against the swing at {info.pwm_hz:.0f} Hz: write shaping = '{kind}' there"
        )
    return f"moves are shaped from the next one on: {info.shaping} (lrmd.toml, [motion] shaping)"


def field_text(field: FieldPart) -> str:
    """Coverage of the reach by a model's residual field."""
    speaks = "not known (the file has no covariance)" if field.speaks_share is None else _percent(field.speaks_share)
    return (
        f"{field.effect} is compensated; share of the poses within the joint limits where it speaks: {speaks}; "
        f"outside the range of the fit, where it fades to zero: {_percent(field.outside_share)}"
    )


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def ik_text(answer: IkAnswer, names: Sequence[str]) -> str:
    """Commanded angles of a solved goal, and its predicted error."""
    commands = answer.q_rad or []
    joints = names[: len(commands)]
    lines = [f"{'':15}" + "".join(f"{name:>9}" for name in joints), _angles("commands (deg)", commands)]
    sd = "not known (the model file has no covariance)" if answer.sd_m is None else f"{answer.sd_m * 1e3:.2f} mm"
    lines.append(f"predicted error {(answer.predicted_error_m or 0.0) * 1e3:.2f} mm, standard deviation {sd}")
    if answer.rounded_error_m is not None:
        turn = f", {math.degrees(answer.rounded_turn_rad):.2f} deg" if answer.rounded_turn_rad else ""
        lines.append(f"after rounding to the board's counts {answer.rounded_error_m * 1e3:.2f} mm{turn} from the goal")
    if answer.detours:
        joints = ", ".join(f"joint{j}" for j in answer.detours)
        lines.append(f"{joints}: the error depends on the side it comes from; come from the other one")
    if any(answer.free_joints[:1]):
        lines.append(f"singular pose: joint{answer.free_joints[0]} can turn while the tool hardly moves")
    lines += _range_lines(answer.outside_range)
    lines += [_angles(f"branch {i} (deg)", q) for i, q in enumerate(answer.branches_rad[1:], start=2)]
    return "\n".join(lines)


def _angles(what: str, q: Sequence[float]) -> str:
    return f"{what:15}" + "".join(f"{math.degrees(a):z9.2f}" for a in q)


def path_text(waypoints: Sequence[Sequence[float]]) -> str:
    """The waypoints of a path, in degrees."""
    rows = [" ".join(f"{math.degrees(a):z8.1f}" for a in q) for q in waypoints]
    moves = "1 straight move" if len(waypoints) == 2 else f"{len(waypoints) - 1} straight moves"
    return "\n".join([f"{moves} through (deg):", *rows])


def tcp_text(answer: FkAnswer) -> str:
    """TCP position, orientation and joint torques."""
    x, y, z = (v * 1e3 for v in answer.tcp_m)
    sd = "" if answer.sd_m is None else f", standard deviation {answer.sd_m * 1e3:.2f} mm"
    (r11, _, _), (r21, _, _), (r31, r32, r33) = answer.rotation
    angles = math.atan2(r32, r33), -math.asin(max(-1.0, min(1.0, r31))), math.atan2(r21, r11)
    rpy = ", ".join(f"{math.degrees(a):z.1f}" for a in angles)
    torques = ", ".join(f"{t:z.3f}" for t in answer.tau_nm)
    lines = [f"TCP at ({x:.1f}, {y:.1f}, {z:.1f}) mm{sd}", f"roll, pitch, yaw ({rpy}) deg", f"torques ({torques}) Nm"]
    return "\n".join([*lines, *_range_lines(answer.outside_range)])


def _range_lines(joints: Sequence[int]) -> list[str]:
    names = ", ".join(f"joint{j}" for j in joints)
    return [f"{names}: outside the range that the model was fitted on; its error there is not known"] if joints else []


def event_line(event: Event) -> str:
    """One event with its local time."""
    seconds, rest = divmod(event.t_wall_ns, 10**9)
    clock = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))
    line = f"{clock}.{rest // 10**6:03d} {event.level:<8}{event.code:<18}{event.text}"
    return paint(line, _LEVEL_COLOURS.get(event.level))
