"""`python -m validation.residual_field.demo_loop`: the loop of the demo, daemon and all, with a field and without.

As `make demo`, of an arm with two effects outside the catalogue, measured at more poses; `auto` names what it can, and
a field is added if the tool finds that it helps. The tip is sent to the same goals with both models, twice each: named,
field, field, named. An arm that comes to a goal by another branch or from another side lands elsewhere: the same model
differs from itself by some tenths of a millimetre RMS.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import math
import tempfile
from pathlib import Path

from examples.demo.pose_files import LOAD_G, pose_table
from examples.demo.steps import DemoSteps
from examples.demo.world import ARM, simulated_world
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from validation.residual_field.closed_loop import unfamiliar

POSES, REPEATS, GOALS = 240, 8, 72
TRACKER = "validation.residual_field.unfamiliar_tracker"


class FieldSteps(DemoSteps):
    """The demo's steps, and those that name everything and add a field."""

    def name_all(self) -> None:
        """Follows the advice to its end."""
        files = self.file("fitted.toml"), self.file("measured.csv"), "-o", self.file("named.toml")
        self._ident("auto", *files, "--no-nested")

    def add_field(self) -> bool:
        """Adds a field; whether the tool found that it helps."""
        files = self.file("named.toml"), self.file("measured.csv"), "residual_field", "-o", self.file("field.toml")
        try:
            self._ident("add", *files)
        except LrmError:
            return False
        return True


def landed(seed: int, poses: int, goals: int) -> tuple[float, float | None]:
    """RMS distance from the goals (mm) with names alone, and with a field too; None if none was added.

    Of each model twice over the goals, in an order in which a slow change of the arm harms none more.
    """
    with (
        tempfile.TemporaryDirectory(prefix="lrm-field-") as out,
        tempfile.TemporaryDirectory(prefix="lrm-demo-") as private,
        simulated_world(Path(private), seed, TRACKER) as world,
    ):
        steps = FieldSteps(Path(out), (*world.daemon, "--tracker", f"dtrack:{world.tracker_port}"), seed, str(goals))
        load = ("--payload-g", str(LOAD_G))  # still on, from measuring
        steps.write_poses(pose_table(load_arm(ARM), poses, REPEATS, seed))
        steps.measure("--load-command", world.load_command)
        steps.fit()
        steps.name_all()

        def reached(model: str, times: int) -> list[float]:
            """RMS distance (mm) of each time over the goals."""
            steps.deploy(f"{model}.toml", *world.daemon)
            return [float(steps.verify(model, *load)["error"]["rms_mm"]) for _ in range(times)]

        named = reached("named", 1)
        if not steps.add_field():
            return named[0], None
        field = reached("field", 2)
        named += reached("named", 1)
        return _rms(named), _rms(field)


def _rms(values: list[float]) -> float:
    return math.sqrt(sum(value**2 for value in values) / len(values))


def main() -> None:
    """Prints one line a seed."""
    asked = argparse.ArgumentParser("validation.residual_field.demo_loop", description=__doc__)
    asked.add_argument("--first", type=int, default=0, help="seed to begin with")
    asked.add_argument("--seeds", type=int, default=10, help="how many")
    asked.add_argument("--poses", type=int, default=POSES)
    asked.add_argument("--goals", type=int, default=GOALS)
    known = asked.parse_args()
    print("| seed | hidden | named mm | with a field mm |\n|---|---|---|---|")
    for seed in range(known.first, known.first + known.seeds):
        with contextlib.redirect_stdout(io.StringIO()):
            named, field = landed(seed, known.poses, known.goals)
        said = "not added" if field is None else f"{field:.2f}"
        print(f"| {seed} | {unfamiliar(seed).name} | {named:.2f} | {said} |", flush=True)


if __name__ == "__main__":
    main()
