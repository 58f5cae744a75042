"""The whole story of an SO-101 on a simulated bus: `python -m examples.so101.story [--seed N] [--out FOLDER]`.

A true SO-101 is drawn by the seed, with one effect hidden in it. It is measured through its servo bus with a tracker
beside it, fitted, diagnosed; the effect is added; and the tip is sent to goals that were never measured, by commands of
the arm as drawn, of the fit, and of the model with the effect. Simulated: the arm, its servos (real packets on a real
pty) and the tracker (real datagrams). Real: every command, and the correction that LeRobot's plug-in uses.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import random
import shlex
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from examples.demo.simulated_tracker import FRAME_SD_M, REST_SD_M
from examples.so101.hidden_arm import HIDDEN
from lerobot_robot_lrm.correction import Correction
from lerobot_robot_lrm.motion import Motion
from lrm_ident.cli.app import app
from lrm_ident.cli.common import show
from lrm_ident.report.document import ResultTable, heading
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of, roberts_sequence
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import model_of

ARM = "so101"
POSES, GOALS = 80, 10
SPEED_DEG_S = 170.0
TIMING = ("--pause", "0", "--settle", "0.05", "--dwell", "0.2", "--speed", str(SPEED_DEG_S))
POSE_RANGE, GOAL_RANGE = math.radians(75.0), math.radians(45.0)
"""Of every joint, from its zero."""
JOINTS = tuple(f"offsets@joint{number}" for number in range(1, 6))
"""Where base and tool are is known: the tracker's targets sit there."""
TRUTHS = {  # another form of a name, and those that a few poses cannot tell from it, are right too
    "play": ("backlash@joint3", "nonlinear_stiffness@joint3", "torque_curve@joint3"),
    "friction": ("hysteresis@joint2", "friction_curve@joint2"),
    "gain": ("servo_gain@joint3", "eccentricity@joint3", "cable_spring@joint3", "angle_curve@joint3"),
}
STARTS_S = 20.0


@dataclass(frozen=True)
class Bench:
    """The simulated arm at a serial device, and the tracker's port."""

    link: Path
    tracker_port: int


@contextmanager
def bench(folder: Path, effect: str, seed: int) -> Iterator[Bench]:
    """Runs arm and tracker, each a process of its own. Raises `LrmError`: they do not start."""
    link = folder / "so101"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    words = [[str(link), effect, str(seed)], [str(link), str(port), str(seed)]]
    running = []
    try:
        for module, arguments in zip(("examples.so101", "examples.so101.tracker"), words, strict=True):
            process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments], stdout=subprocess.PIPE, text=True, stderr=subprocess.DEVNULL
            )
            running.append(process)
            end = time.monotonic() + STARTS_S
            while not link.exists():
                if process.poll() is not None or time.monotonic() > end:
                    raise LrmError(f"{module} does not start")
                time.sleep(0.05)
        yield Bench(link, port)
    finally:
        for process in running:
            process.kill()
            process.wait()


@dataclass(frozen=True)
class Story:
    """The steps, in a folder; each is a command that a person would type."""

    folder: Path
    bench: Bench
    seed: int

    def file(self, name: str) -> str:
        """A path in the folder, as a word."""
        return str(self.folder / name)

    def measure(self, poses: str, data: str) -> None:
        """Drives through poses, and measures the tip at each."""
        (self.folder / data).unlink(missing_ok=True)
        (self.folder / data).with_suffix(".toml").unlink(missing_ok=True)
        where = ["--robot", f"feetech:{self.bench.link}", "--tracker", f"dtrack:{self.bench.tracker_port}"]
        run("measure", self.file(poses), *where, *TIMING, "-o", self.file(data))

    def write_poses(self, name: str, q: Array) -> None:
        """Writes a pose file of commands (N, n), rad."""
        rows = [[number, *np.degrees(row).round(5).tolist()] for number, row in enumerate(q, start=1)]
        with (self.folder / name).open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([["pose", *(f"q{i}_deg" for i in range(1, q.shape[1] + 1))], *rows])

    def identify(self) -> tuple[str, str]:
        """Measures, fits, and diagnoses: the verdict, and the name of what is missing."""
        self.write_poses("poses.csv", drawn(self.seed, POSES, POSE_RANGE))
        self.measure("poses.csv", "measured.csv")
        run(
            "fit",
            self.file("measured.csv"),
            "--effects",
            ",".join([*JOINTS, "compliance"]),
            "-o",
            self.file("fitted.toml"),
        )
        run("diagnose", self.file("fitted.toml"), self.file("measured.csv"), "--json", self.file("diagnosis.json"))
        found = json.loads((self.folder / "diagnosis.json").read_text(encoding="utf-8"))
        first = next((one for one in found["ranking"] if one["verdict"] != "no_evidence"), None)
        return found["verdict"], "" if first is None else f"{first['effect']}@{first['place']}"

    def add(self, effect: str) -> None:
        """The model with the effect."""
        run("add", self.file("fitted.toml"), self.file("measured.csv"), effect, "-o", self.file("better.toml"))

    def land(self, name: str, model: str) -> float:
        """Sends the tip to the goals by the commands of a model file (empty: the arm as drawn); RMS of its error, m."""
        wishes, goals = goals_of(self.seed)
        commands = wishes if not model else commands_of(Path(self.file(model)), wishes)
        self.write_poses(f"goals-{name}.csv", np.concatenate([np.zeros((1, wishes.shape[1])), commands]))
        self.measure(f"goals-{name}.csv", f"landed-{name}.csv")
        table = np.genfromtxt(self.folder / f"landed-{name}.csv", delimiter=",", names=True)
        tips = 1e-3 * np.stack([table[f"{axis}_mm"] for axis in "xyz"], axis=1)
        return float(np.sqrt(((tips[1:] - goals) ** 2).sum(axis=1).mean()))


def run(*words: str) -> None:
    """Runs a command of `lrm-ident` in this process. Raises `LrmError`."""
    show("", heading(f"$ lrm-ident {shlex.join(words)}"))
    began = time.monotonic()
    code = app(list(words), standalone_mode=False)
    show(f"({time.monotonic() - began:.1f} s)")
    if code:
        raise LrmError(f"lrm-ident {words[0]} ended with exit code {code}")


def goals_of(seed: int) -> tuple[Array, Array]:
    """(K, n) wished angles (rad) that the arm as drawn would need, and (K, 3) its tips there (m): the goals."""
    wishes = drawn(seed + 1, GOALS, GOAL_RANGE)
    return wishes, equilibrium(model_of(load_arm(ARM), ()), poses_of(wishes)).tcp


def drawn(seed: int, count: int, most: float) -> Array:
    """(count, n), angles spread evenly over ±`most` (rad) of every joint, in random order."""
    rng, n = np.random.default_rng([seed, 101]), load_arm(ARM).dof
    spread = (roberts_sequence(count, n) + rng.random(n)) % 1.0
    return np.asarray(rng.permutation(2.0 * spread - 1.0) * most)


def commands_of(model: Path, wishes: Array) -> Array:
    """(K, n), commands (rad) that bring a calibrated arm's tool where the drawn one's would be at wished angles."""
    correction, out = Correction.of_file(model), []
    motion = Motion.at(np.zeros(wishes.shape[1]))
    for wish in wishes:
        command = correction.command(wish, motion)
        motion = motion.to(command)
        out.append(command)
    return np.array(out)


@dataclass(frozen=True)
class Ending:
    """End of the story: what was hidden and what was named, RMS of the tip's error (m) by whose commands, and s."""

    seed: int
    effect: str
    verdict: str
    named: str
    landed: dict[str, float]
    seconds: float

    @property
    def right(self) -> bool:
        """Whether what was named is what was hidden."""
        return bool(self.named) and self.named in TRUTHS[self.effect]

    def tell(self, folder: Path) -> None:
        """The last screen, and the same as `so101.json`."""
        floor = 1e3 * math.sqrt(3.0) * math.hypot(REST_SD_M, FRAME_SD_M / 3.0)
        rows = [(name, 1e3 * error, floor) for name, error in self.landed.items()]
        columns = ("commands of", "RMS|.2f", "tracker's noise|.2f")
        show(
            "",
            ResultTable(columns, rows, f"How far the tip lands from {GOALS} goals that were never measured, mm"),
            f"Hidden by seed {self.seed}: {self.effect} ({' or '.join(TRUTHS[self.effect])}).",
            f"Named: {self.named or self.verdict}: {'right' if self.right else 'NOT what was hidden'}.",
            f"All in {self.seconds:.0f} s. On a real arm: docs/your-arm.md.",
        )
        values: dict[str, Any] = {
            "schema": "lrm/so101-demo/1", "seed": self.seed, "hidden": TRUTHS[self.effect], "verdict": self.verdict,
            "named": self.named, "right": self.right, "seconds": self.seconds,
            "rms_mm": {name: 1e3 * error for name, error in self.landed.items()},
        }  # fmt: skip
        (folder / "so101.json").write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")


def main(argv: list[str] | None = None) -> int:
    """Tells the story. Exit code 0, or 2 with one line that says what failed."""
    p = argparse.ArgumentParser(
        "examples.so101.story", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    p.add_argument("--seed", type=int, help="of what is hidden; drawn and printed if not given")
    p.add_argument("--effect", choices=tuple(HIDDEN), help="what is hidden; drawn by the seed if not given")
    p.add_argument("--out", type=Path, default=Path("out"), help="where the files go (default: %(default)s)")
    options = p.parse_args(argv)
    seed = int.from_bytes(os.urandom(2), "big") if options.seed is None else options.seed
    effect, began = options.effect or random.Random(seed).choice(sorted(HIDDEN)), time.monotonic()
    folder = options.out / ARM
    show(heading(f"Seed {seed}: `make demo ARM={ARM} SEED={seed}` tells the same story again."))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="lrm-so101-") as private, bench(Path(private), effect, seed) as world:
            story = Story(folder, world, seed)
            landed = {"the arm as drawn": story.land("nominal", "")}
            verdict, named = story.identify()
            landed["the fit"] = story.land("fitted", "fitted.toml")
            if verdict == "effect_missing":
                story.add(named)
                landed[f"the fit with {named}"] = story.land("better", "better.toml")
        Ending(seed, effect, verdict, named, landed, time.monotonic() - began).tell(folder)
    except (LrmError, OSError) as error:
        print(f"examples.so101.story: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
