"""`python -m validation.swinging_arm [moves|campaign] [--moves 50] [--pwm 50 330] [--frames] [--json FILE]`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.measuring.campaign.data_file import DataFile
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.run import PoseCampaign, PoseTiming, PredictedSettling
from lrm_ident.measuring.tracker.frames import TargetNumbers
from lrm_math.arrays import Array
from validation.swinging_arm.rig import SwingingRover, tip_of

WITHIN_MM, FOLLOWED, RESIDUAL = 0.5, 1000, slice(30, 330)
"""Distance of a rest; ticks for which a tip is followed, and those after a move of which its swing is taken, 2 s from
0.2 s on."""
KINDS = ("off", "zv", "timed")
DWELL_S = 1.0


def moved(pwm_hz: float, kind: str, moves: int, off: float, frames: bool) -> dict[str, list[float]]:
    """Random moves one after the other: duration, settling predicted and true (s), largest swing and its RMS (mm)."""
    rover = SwingingRover(pwm_hz, kind, WITHIN_MM, off, in_frames=frames)
    rng = np.random.default_rng(3)
    rows = []
    for _ in range(moves):
        seconds, leg = rover.move(rng.uniform(-1.0, 1.0, rover.arm.dof))
        predicted = rover.known.settle_s(leg)
        tips = rover.tips(FOLLOWED)
        away = 1e3 * np.linalg.norm(tips - tips[-1], axis=1)
        far = np.flatnonzero(away > WITHIN_MM)
        true = (far[-1] + 1) * rover.tick_s if len(far) else 0.0
        rest = away[RESIDUAL]
        rows.append((seconds, predicted, true, rest.max(), np.sqrt(np.mean(rest**2))))
    names = ("duration_s", "predicted_s", "true_s", "swing_mm", "swing_rms_mm")
    return {name: [float(v) for v in column] for name, column in zip(names, zip(*rows, strict=True), strict=True)}


def moves_table(pwm: list[float], kinds: list[str], moves: int, off: float, frames: bool) -> list[dict[str, object]]:
    """Prints one line for each frequency of the pulses and each shaper."""
    out: list[dict[str, object]] = []
    for hz in pwm:
        plain: dict[str, list[float]] = {}
        for kind in kinds:
            found = moved(hz, kind, moves, off, frames)
            plain = plain or found
            predicted, true = np.array(found["predicted_s"]), np.array(found["true_s"])
            near = np.mean((np.abs(predicted - true) < 0.2 * true) | (np.abs(predicted - true) < 0.1))
            less = np.mean(plain["swing_rms_mm"]) / np.mean(found["swing_rms_mm"])
            longer = np.mean(found["duration_s"]) / np.mean(plain["duration_s"]) - 1.0
            print(
                f"{hz:5.0f} Hz {kind:4} swing {np.mean(found['swing_rms_mm']):6.3f} mm RMS (median of the largest "
                f"{np.median(found['swing_mm']):.3f}), {less:5.1f} times less, {100 * longer:4.1f} % longer; settling "
                f"{true.mean():.2f} s, predicted within 20 % or 0.1 s: {100 * near:.0f} %, median of predicted/true "
                f"{np.median(predicted[true > 0.1] / true[true > 0.1]) if np.any(true > 0.1) else np.nan:.2f}",
                flush=True,
            )
            out.append({"pwm_hz": hz, "shaping": kind, "off": off, "frames": frames, **found})
    return out


def campaign_table(pwm: list[float], poses: int, frames: bool) -> list[dict[str, object]]:
    """Prints time and error of a campaign with a fixed pause, by the model, and with half a second only."""
    out: list[dict[str, object]] = []
    for hz in pwm:
        for name, kind, timing in (
            ("pause 15 s", "off", PoseTiming(15.0, 0.5, DWELL_S)),
            ("settle auto", "off", PredictedSettling(0.0, 0.0, DWELL_S)),
            ("settle auto, zv", "zv", PredictedSettling(0.0, 0.0, DWELL_S)),
            ("settle auto, timed", "timed", PredictedSettling(0.0, 0.0, DWELL_S)),
            ("settle 0.5 s", "off", PoseTiming(0.0, 0.5, DWELL_S)),
        ):
            rover = SwingingRover(hz, kind, 0.1, dead_band=0.0, in_frames=frames)
            rng = np.random.default_rng(5)
            plan = [PlannedPose(k + 1, tuple(rng.uniform(-1.0, 1.0, 6).tolist()), 0.0, (), k + 1) for k in range(poses)]
            seconds, errors = measured(rover, plan, timing)
            rms = float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))
            print(
                f"{hz:5.0f} Hz {name:20} {seconds:5.0f} s, {len(errors)} poses, error {1e3 * rms:.3f} mm RMS, largest "
                f"{1e3 * np.linalg.norm(errors, axis=1).max():.3f}",
                flush=True,
            )
            out.append({"pwm_hz": hz, "frames": frames, "timing": name, "seconds": seconds, "error_rms_mm": 1e3 * rms})
    return out


def measured(rover: SwingingRover, plan: list[PlannedPose], timing: PoseTiming) -> tuple[float, Array]:
    """Time (s) of a campaign, and errors (N, 3), m, of what it measured against the tips at rest."""
    path = Path(mkdtemp()) / "data.csv"
    begun, file = rover.now(), DataFile(path, rover.arm.dof)
    file.check_plan("plan")
    with file:
        file.begin("power", "lrm-rover", "simulated", start_q_deg=[0.0] * 6, poses_sha256="plan", t0_s=rover.now())
        campaign = PoseCampaign(rover, rover, TargetNumbers(1, None), rover, timing, plan[0], lambda _: None)
        campaign.run(plan, file)
    seconds, data = rover.now() - begun, load_measurements(path, rover.arm)
    clock, servos = rover.config.clock, rover.config.servos[: rover.arm.dof]
    counts = [clock.counts_of([s.pulse_ns(a) * 1e-9 for s, a in zip(servos, q, strict=True)]) for q in data.poses.q]
    stands = [[float(s.table.angle_of(p)) for s, p in zip(servos, clock.pulse_of(row), strict=True)] for row in counts]
    return seconds, np.asarray(data.tcp - tip_of(rover.arm, np.array(stands)))


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="?", choices=["moves", "campaign", "all"], default="all")
    parser.add_argument("--moves", type=int, default=50)
    parser.add_argument("--poses", type=int, default=60)
    parser.add_argument("--pwm", type=float, nargs="+", default=[50.0, 330.0])
    parser.add_argument("--off", type=float, default=0.0, help="relative error of the model's frequencies")
    parser.add_argument("--frames", action="store_true", help="servos see new pulses at the board's frames only")
    parser.add_argument("--kinds", nargs="+", default=KINDS, help="of shaping")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    found: dict[str, object] = {}
    if given.what != "campaign":
        found["moves"] = moves_table(given.pwm, given.kinds, given.moves, given.off, given.frames)
    if given.what != "moves":
        found["campaign"] = campaign_table(given.pwm, given.poses, given.frames)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
