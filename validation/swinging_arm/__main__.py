"""A campaign with `--settle auto`.

`python -m validation.swinging_arm [--poses 60] [--pwm 50] [--frames] [--only WORD] [--json FILE]`
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.measuring.campaign.data_file import DataFile, PowerOn
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.run import PoseCampaign, PoseTiming, PredictedSettling
from lrm_ident.measuring.tracker.frames import TargetNumbers
from lrm_math.arrays import Array
from validation.swinging_arm.rig import SwingingRover, tip_of

DWELL_S = 1.0


def campaign_table(pwm: list[float], poses: int, frames: bool, only: str) -> list[dict[str, object]]:
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
            if only not in name:
                continue
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
        file.begin(PowerOn("power"), rover.now(), "lrm-rover", "simulated", start_q_deg=[0.0] * 6, poses_sha256="plan")
        campaign = PoseCampaign(rover, rover, TargetNumbers(1, None), rover, timing, plan[0], lambda _: None)
        campaign.run(plan, file)
    seconds, data = rover.now() - begun, load_measurements(path, rover.arm)
    clock, servos = rover.config.clock, rover.config.servos[: rover.arm.dof]
    counts = [clock.counts_of([s.pulse_ns(a) * 1e-9 for s, a in zip(servos, q, strict=True)]) for q in data.poses.q]
    stands = [[float(s.table.angle_of(p)) for s, p in zip(servos, clock.pulse_of(row), strict=True)] for row in counts]
    return seconds, np.asarray(data.tcp - tip_of(rover.arm, np.array(stands)))


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=60)
    parser.add_argument("--pwm", type=float, nargs="+", default=[50.0])
    parser.add_argument("--frames", action="store_true", help="servos see new pulses at the board's frames only")
    parser.add_argument("--only", default="", metavar="WORD", help="only rows with this word in their name")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    found = campaign_table(given.pwm, given.poses, given.frames, given.only)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
