"""The steps of the demo: each is a command that a person would type, with the files that it reads and writes."""

from __future__ import annotations

import json
import shlex
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lrm_ident.cli.app import app
from lrm_ident.cli.common import show
from lrm_ident.report.document import heading
from lrm_math.command_line import INTERRUPTED
from lrm_math.effects import EffectRef
from lrm_math.errors import LrmError
from lrmd.cli import app as lrm
from lrmd.client.deployment import Deployment

SETTLE_S, DWELL_S = 0.05, 0.2
"""Of the computer's clock; the simulated arm's runs faster."""


"""Exit codes of a command of `lrm-ident` that a signal ended: what follows it is not run either."""
TIMING = ("--settle", str(SETTLE_S), "--dwell", str(DWELL_S))


@dataclass(frozen=True)
class NamedEffect:
    """Finding of `diagnose`: its verdict, the effect that it would add, those that the data cannot tell from it."""

    verdict: str
    name: str
    rivals: tuple[str, ...]
    floor_mm: float | None

    @property
    def to_add(self) -> bool:
        """Whether there is one, with which unseen poses are predicted better."""
        return self.verdict in ("effect_missing", "effect_describes")

    @property
    def words(self) -> str:
        """Sentence for a person."""
        if not self.to_add:
            return self.verdict.replace("_", " ")
        return f"{self.name}, or {', '.join(self.rivals)}" if self.rivals else self.name

    def agrees(self, truth: str) -> bool:
        """Whether the truth is what was named, or among what was named with it."""
        return self.to_add and truth in (self.name, *self.rivals)


@dataclass(frozen=True)
class MotionFit:
    """RMS errors (deg) of each joint: of its command, of a model at moves that the fit did not use, of its encoder."""

    command_deg: tuple[float, ...]
    held_out_deg: tuple[float, ...]
    noise_deg: tuple[float, ...]

    @classmethod
    def of(cls, path: Path) -> MotionFit:
        """From the values of `motion fit` or `add`."""
        joints = read_json(path)["joints"]
        return cls(*(tuple(one[f"{name}_deg"] for one in joints) for name in ("command", "held_out", "noise")))


@dataclass(frozen=True)
class DemoSteps:
    """A demo in a folder.

    `arm`: words of `measure` and `verify` that name the simulated arm and its tracker, `timing` for how long they rest.
    `goals`: those that are verified, as `verify` takes them.
    """

    folder: Path
    arm: tuple[str, ...]
    seed: int
    goals: str
    timing: tuple[str, ...] = TIMING

    def file(self, name: str) -> str:
        """A path in the folder, as a word."""
        return str(self.folder / name)

    def write_poses(self, table: str) -> None:
        """Poses of one's own."""
        (self.folder / "poses.csv").write_text(table, encoding="utf-8")

    def measure(self, *more: str) -> None:
        """Measures the poses."""
        files = self.file("poses.csv"), *self.arm, "--pause", "0", *self.timing, *more, "-o", self.file("measured.csv")
        self._ident("measure", *files)

    def calibrate_camera(self, photos: str) -> None:
        """The lens, from photos of the board."""
        self._ident("camera", "calibrate", self.file(photos), "-o", self.file("lens.toml"))

    def photograph(self, camera: str, arm: str, *driven: str) -> None:
        """Measures the poses with a camera."""
        files = "--poses", self.file("poses.csv"), "--lens", self.file("lens.toml"), "--arm", arm
        self._ident("camera", "read", camera, *driven, *self.timing, *files, "-o", self.file("measured.csv"))

    def verify(self, name: str, *more: str) -> dict[str, Any]:
        """Sends the tip to goals that were never measured; the result's values."""
        result = self.file(f"goals-{name}.json")
        goals = ["--goals", self.goals, "--seed", str(self.seed), *more]
        self._ident("verify", *self.arm, *self.timing, *goals, "--json", result)
        return read_json(Path(result))

    def fit(self, *more: str) -> None:
        """The thesis's model: geometry, and the springs of joints and base."""
        self._ident("fit", self.file("measured.csv"), *more, "-o", self.file("fitted.toml"))

    def compare(self) -> None:
        """Figures of where the model fails."""
        self._ident("compare", self.file("fitted.toml"), self.file("measured.csv"))

    def diagnose(self) -> NamedEffect:
        """Diagnosis of what the model misses."""
        result = self.file("diagnosis.json")
        self._ident("diagnose", self.file("fitted.toml"), self.file("measured.csv"), "--json", result)
        found = read_json(Path(result))
        first = next((one for one in found["ranking"] if one["verdict"] != "no_evidence"), None)
        if first is None:
            return NamedEffect(found["verdict"], "", (), found["noise_floor_rms_mm"])
        name = str(EffectRef(first["effect"], first["place"]))
        return NamedEffect(found["verdict"], name, tuple(first["indistinguishable_from"]), found["noise_floor_rms_mm"])

    def add(self, effect: str) -> None:
        """The model with the effect."""
        files = self.file("fitted.toml"), self.file("measured.csv"), effect, "-o", self.file("better.toml")
        self._ident("add", *files)

    def deploy(self, name: str, *daemon: str) -> None:
        """Gives a model to a daemon, named by words of `lrm`; a refusal is shown, and then accepted."""
        words, refusal = [*daemon, "deploy", self.file(name)], Deployment.of_file(self.folder / name).refusal
        if refusal:
            show("", f"`lrm deploy` refuses this model: {refusal}. The demo accepts it, to show how well it does.")
        self._run("lrm", [*words, "--accept"])  # the arm drawn may be further from nominal than a fifth of its reach

    def report(self, name: str) -> str:
        """The page of a model; gives its verdict."""
        page, result = self.file("report.html"), self.file("report.json")
        self._ident("report", self.file(name), self.file("measured.csv"), "-o", page, "--json", result)
        return str(read_json(Path(result))["diagnosis"]["conclusion"]["headline"])

    def fit_motion(self, recording: str) -> MotionFit:
        """The response of the servos, from a recording in the folder."""
        result = self.file("motion-fit.json")
        files = self.file(recording), "--arm", "so101", "-o", self.file("motion.toml")
        self._ident("motion", "fit", *files, "--json", result)
        return MotionFit.of(Path(result))

    def diagnose_motion(self, recording: str) -> NamedEffect:
        """Diagnosis of what the model of motion misses."""
        result = self.file("motion-diagnosis.json")
        self._ident("motion", "diagnose", self.file("motion.toml"), self.file(recording), "--json", result)
        names = {str(EffectRef(one["effect"], one["place"])): one for one in read_json(Path(result))["ranking"]}
        first = next((name for name, one in names.items() if one["verdict"] == "supported"), None)
        if first is None:
            return NamedEffect("no_evidence", "", (), None)
        rivals = tuple(name for name, one in names.items() if one["indistinguishable"] and name != first)
        return NamedEffect("effect_missing", first, rivals, None)

    def add_motion(self, recording: str, effect: str) -> MotionFit:
        """The model of motion with the effect."""
        result = self.file("motion-better.json")
        files = self.file("motion.toml"), self.file(recording), effect, "-o", self.file("motion-better.toml")
        self._ident("motion", "add", *files, "--json", result)
        return MotionFit.of(Path(result))

    def _ident(self, *words: str) -> None:
        self._run("lrm-ident", words)

    def _run(self, program: str, words: Sequence[str]) -> None:
        """Runs a command in this process. Raises `LrmError`, and `SystemExit` where the command was told to end."""
        show("", heading(f"$ {program} {shlex.join(words)}"))
        began = time.monotonic()
        code = lrm.main(list(words)) if program == "lrm" else app(list(words), standalone_mode=False)
        show(f"({time.monotonic() - began:.1f} s)")
        if code == INTERRUPTED or (code == 1 and program != "lrm"):  # 1: told to end, by older typer
            raise SystemExit(code)
        if code:
            raise LrmError(f"{program} {words[0]} ended with exit code {code}")


def read_json(path: Path) -> dict[str, Any]:
    """The values of a result."""
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found
