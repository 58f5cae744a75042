"""One loop: measure, fit, name, deploy, and send the tip to goals, by the commands and the daemon.

Every visit has a board and a daemon of its own: a fault of one, as on a busy computer, costs that visit alone.
"""

from __future__ import annotations

import contextlib
import io
import shlex
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from examples.demo.pose_files import LOAD_G, pose_table
from examples.demo.steps import DWELL_S, SETTLE_S, DemoSteps, read_json
from examples.demo.world import ARM, SPEED, World, simulated_world
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from validation.as_deployed.board.goal_visits import GoalVisits, tried
from validation.as_deployed.board.passing_world import PassingWorld
from validation.as_deployed.outcome import Record

POSES, REPEATS, GOALS = 160, 8, 36
KNOWN, MEASURING, AFTERWARDS = (f"validation.as_deployed.board.{name}" for name in ("known", "measuring", "afterwards"))


class NamingSteps(DemoSteps):
    """The demo's steps, and `auto` to its end."""

    def name_all(self) -> Record:
        """Its steps and its verdict."""
        files = self.file("fitted.toml"), self.file("measured.csv"), "-o", self.file("named.toml")
        self._ident("auto", *files, "--no-nested", "--json", self.file("course.json"))
        found = read_json(Path(self.file("course.json")))
        steps = [
            {"added": one["added"], "claim": one["is"], "names": [one["added"], *one["indistinguishable_from"]]}
            for one in found["steps"]
            if one["added"]
        ]
        return {"steps": steps, "verdict": found["verdict"]}


@dataclass(frozen=True)
class SeedLoop:
    """The loop of a seed, its files in a folder; `speed`: of the board's clock against the computer's."""

    seed: int
    steps: NamingSteps
    visits: GoalVisits
    speed: float

    def measured(self, tracker: str) -> None:
        """Measures all poses, anew from the first where it was interrupted: the target is pushed but once."""
        self.steps.write_poses(pose_table(load_arm(ARM), POSES, REPEATS, self.seed))

        def measure() -> None:
            for suffix in ("csv", "toml"):
                Path(self.steps.file(f"measured.{suffix}")).unlink(missing_ok=True)
            with _world(self.seed, tracker, self.speed) as world:
                arm = (*world.daemon, "--tracker", f"dtrack:{world.tracker_port}")
                replace(self.steps, arm=arm).measure("--load-command", world.load_command)

        tried(measure)
        self.steps.fit()

    def errors(self, tracker: str, model: str) -> Array:
        """(GOALS,), squared distances from the goals (m²) with a model deployed; NaN where one was not reached."""

        def visit() -> Array:
            with _world(self.seed, tracker, self.speed) as world:
                subprocess.run([*shlex.split(world.load_command), f"{LOAD_G:g}"], check=True)
                self.steps.deploy(model, *world.daemon)
                return self.visits.visit(world, SPEED / self.speed)

        return tried(visit)


def loop_record(seed: int, speed: float = SPEED) -> Record:
    """RMS distance from the goals in mm: with the plain fit, after `auto`, and with all causes known. Never raises."""
    began = time.monotonic()
    try:
        with tempfile.TemporaryDirectory(prefix="lrm-as-deployed-") as out, contextlib.redirect_stdout(io.StringIO()):
            record = _record(seed, Path(out), speed)
    except LrmError as problem:
        record = {"trouble": str(problem)}
    return {"hidden": PassingWorld(seed).hidden, **record, "seconds": round(time.monotonic() - began)}


def _record(seed: int, out: Path, speed: float) -> Record:
    visits, slower = GoalVisits.of(GOALS, seed), SPEED / speed
    timing = ("--settle", f"{slower * SETTLE_S:g}", "--dwell", f"{slower * DWELL_S:g}")
    unknown, known = (
        SeedLoop(seed, NamingSteps(_made(out / name), (), seed, str(GOALS), timing), visits, speed)
        for name in ("a", "b")
    )
    unknown.measured(MEASURING)
    named = unknown.steps.name_all()
    known.measured(KNOWN)
    found = {
        "before": unknown.errors(AFTERWARDS, "fitted.toml"),
        "after": unknown.errors(AFTERWARDS, "named.toml"),
        "floor": known.errors(KNOWN, "fitted.toml"),
    }
    reached = np.isfinite(np.stack([*found.values()])).all(axis=0)
    record: Record = {f"{name}_mm": float(f"{_rms_mm(of[reached]):.4g}") for name, of in found.items()}
    return record | {"goals": int(reached.sum()), **named}


def _rms_mm(squares: Array) -> float:
    return 1e3 * float(np.sqrt(squares.mean()))


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


@contextmanager
def _world(seed: int, tracker: str, speed: float) -> Iterator[World]:
    """The arm of a seed, seen by a tracker, with files of its own."""
    with (
        tempfile.TemporaryDirectory(prefix="lrm-demo-") as private,
        simulated_world(Path(private), seed, tracker, speed) as world,
    ):
        yield world
