"""A campaign with `--settle auto`.

`python -m validation.swinging_arm [--poses 60] [--pwm 50] [--frames] [--only WORD] [--json FILE]`
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.measuring.campaign.data_file import DataFile, PowerOn
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.run import PoseCampaign, PoseTiming, PredictedSettling
from lrm_ident.measuring.tracker.frames import TargetNumbers
from lrm_math.arrays import Array
from validation.options import Count, asked
from validation.runner import json_text, run_cases
from validation.swinging_arm.rig import SwingingRover, tip_of
from validation.tables import markdown_table, table_row

DWELL_S = 1.0


TIMINGS: dict[str, tuple[str, PoseTiming]] = {
    "pause 15 s": ("off", PoseTiming(15.0, 0.5, DWELL_S)),
    "settle auto": ("off", PredictedSettling(0.0, 0.0, DWELL_S)),
    "settle auto, zv": ("zv", PredictedSettling(0.0, 0.0, DWELL_S)),
    "settle auto, timed": ("timed", PredictedSettling(0.0, 0.0, DWELL_S)),
    "settle 0.5 s": ("off", PoseTiming(0.0, 0.5, DWELL_S)),
}
"""By name: shaping of the moves, and when a pose is measured: after a fixed pause, by the model, at once."""


def examine(poses: int, frames: bool, case: tuple[float, str]) -> dict[str, object]:
    """Time and error of a campaign, by the frequency of the pulses (Hz) and the name of its timing."""
    hz, name = case
    kind, timing = TIMINGS[name]
    rover = SwingingRover(hz, kind, 0.1, dead_band=0.0, in_frames=frames)
    rng = np.random.default_rng(5)
    plan = [PlannedPose(k + 1, tuple(rng.uniform(-1.0, 1.0, 6).tolist()), 0.0, (), k + 1) for k in range(poses)]
    seconds, errors = measured(rover, plan, timing)
    error = error_stats(errors)
    figures = {"seconds": seconds, "error_rms_mm": 1e3 * error.rms, "error_max_mm": 1e3 * error.max}
    return {"pwm_hz": hz, "frames": frames, "timing": name, "poses": len(errors), **figures}


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


COLUMNS = {
    "pulses, Hz": "{pwm_hz:.0f}",
    "timing": "{timing}",
    "s": "{seconds:.0f}",
    "poses": "{poses}",
    "error, mm RMS": "{error_rms_mm:.3f}",
    "largest, mm": "{error_max_mm:.3f}",
}


def main() -> None:
    """Prints the table."""
    given = asked(
        __doc__,
        poses=Count(60),
        pwm=[50.0],
        frames=(False, "servos see new pulses at the board's frames only"),
        only=("", "only rows with this word in their name"),
        json=None,
        jobs=1,
    )
    cases = {f"{hz:g} Hz, {name}": (hz, name) for hz in given.pwm for name in TIMINGS if given.only in name}
    found = [*run_cases(cases, partial(examine, given.poses, given.frames), _line, given.jobs).values()]
    print(markdown_table([*COLUMNS], [_cells(one) for one in found]))
    if given.json:
        given.json.write_text(json_text(found), "utf-8")


def _cells(one: dict[str, object]) -> list[str]:
    return [how.format(**one) for how in COLUMNS.values()]


def _line(_key: str, one: dict[str, object]) -> str:
    return table_row(_cells(one))


if __name__ == "__main__":
    main()
