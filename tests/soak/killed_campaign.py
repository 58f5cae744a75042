"""A campaign on the real daemon killed at random moments and resumed, until it is complete.

`python -m tests.soak.killed_campaign --kills 50`: `lrm-ident measure` drives a simulated board over zenoh, and is
killed (SIGKILL) at a random moment after its start, again and again. After every kill the arm must hold with its
pulses on, and no row that was in the file may be gone; in the end every pose of the plan is there once, where the arm
was sent.
Exit code 1 if not.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.measuring.tracker.dtrack import UdpTracker
from lrm_math.arm.arm_file import load_arm
from lrmd.client import Rover
from tests.support.daemon.daemon_process import SLOW_BOARD, DaemonSetup, running_daemon, wait_for
from tests.support.daemon.tracker_of_board import tracker_of
from validation.options import Count, asked

START = (0.0, -60.0, 0.0, 0.0, 0.0, 0.0)
LATEST_S = 8.0
"""s after its start at which a campaign is killed at the latest: it takes about two until the first pose."""
HEAD = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n"


def poses(count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 6), deg, around the start, clear of everything."""
    return np.array(START) + rng.uniform(-25.0, 25.0, size=(count, 6)).round(1) * [1, 0.4, 1, 1, 1, 1]


def rows(data: Path) -> list[bytes]:
    """The whole lines of a file."""
    return data.read_bytes().split(b"\n")[:-1] if data.exists() else []


def killed(command: list[str], data: Path, after: float, rover: Rover) -> str:
    """One run, killed after so many seconds; what was wrong then, or empty."""
    before = rows(data)
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        time.sleep(after)
        process.kill()
    try:
        wait_for(lambda: rover.mode().holder is None, "the lease ends", 30.0)
        wait_for(lambda: rover.mode().mode in ("holding", "armed"), "it holds", 30.0)
    except AssertionError as error:
        return str(error)
    if not all(rover.joints().on[:6]):
        return "the pulses are off"
    return "" if rows(data)[: len(before)] == before else "rows are gone"


def main() -> int:
    """Kills, then lets it finish, and says what is in the file."""
    options = asked(__doc__, kills=Count(50), seed=0)
    rng, faults = np.random.default_rng(options.seed), list[str]()
    with tempfile.TemporaryDirectory(prefix="lrm-killed-") as folder:
        setup = DaemonSetup.make(Path(folder), {**SLOW_BOARD, "step_us = 1.0": "step_us = 10.0"})
        q = poses(3 * options.kills + 10, rng)
        plan, data = Path(folder) / "poses.csv", Path(folder) / "data.csv"
        lines = [",".join([str(k), *(f"{angle:.1f}" for angle in row)]) for k, row in enumerate(q, start=1)]
        plan.write_text(HEAD + "\n".join(lines) + "\n")
        with UdpTracker("127.0.0.1", 0) as probe:
            port = probe.port
        command = [sys.executable, "-m", "lrm_ident", "measure", str(plan), "--connect", setup.endpoint]
        command += ["--tracker", f"dtrack:{port}", "-o", str(data)]
        command += ["--pause", "0.3", "--settle", "0.1", "--dwell", "0.2"]
        daemon = running_daemon(setup, "--start-deg", ",".join(map(str, START)))
        with daemon as (board, _), tracker_of(board, port), setup.rover() as rover:
            names = rover.info().names[:6]
            with rover.control("soak"):
                rover.arm("given", dict(zip(names, np.radians(START).tolist(), strict=True)))
            for number in range(1, options.kills + 1):
                fault = killed(command, data, float(rng.uniform(0.0, LATEST_S)), rover)
                faults += [f"kill {number}: {fault}"] if fault else []
                print(f"kill {number}: {max(len(rows(data)) - 1, 0)} rows{f'; {fault}' if fault else ''}", flush=True)
            subprocess.run(command, check=True)
        found = load_measurements(data, load_arm("lrm-rover"))
        missing = sorted(set(range(1, len(q) + 1)) - set(found.pose.tolist()))
        off = np.abs(np.degrees(found.poses.q) - q[found.pose - 1]).max()
    poses_words = f"{len(found)} of {len(q)} poses, {len(missing)} missing, none twice"
    print(f"{options.kills} kills: {poses_words}; off by {off:.2f} deg at most")
    print("\n".join(faults) or "the arm held after every kill, and no row was lost")
    return int(bool(faults or missing or off > 0.1))


if __name__ == "__main__":
    sys.exit(main())
