"""The whole story on a simulated SO-101: `python -m examples.so101.demo [--seed N] [--out FOLDER]`.

An SO-101 is drawn by the seed, with one effect hidden in it that the model does not have, a printed board on its
gripper and a webcam beside it. The lens is calibrated, the arm driven to poses and photographed, the photos fitted,
what is missing named and added; and goals that were never photographed are visited: with commands of the arm as drawn,
corrected by the fitted model, and by that with the effect. What is simulated: the arm, its Feetech servos (their real
protocol on a real pty) and the camera (rendered pictures from a real address). What is real: every command, and the
detector. At the end the arm's motion is recorded, a cause that its servos hide is named and added, and the error of
unseen moves falls (`examples.so101.motion_demo`).
"""

from __future__ import annotations

import math
import shutil
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from examples.demo.conclusion import DemoTruth, conclude
from examples.demo.options import run_in_folder
from examples.demo.steps import DemoSteps
from examples.so101.camera import ARM, DRAWN, SCENE, poses_for_photos
from examples.so101.hidden_arm import NAMED, SIMPLER
from examples.so101.launch import SPEED, simulated_camera, simulated_so101
from examples.so101.motion_demo import show_motion
from lrm_ident.cli.common import show
from lrm_ident.measuring.verification.goal_commands import GoalCommand, ModelSolver
from lrm_ident.report.document import heading
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.goal import point
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from validation.camera.scene import write_lens_photos

PHOTOS, LENS_PHOTOS, GOALS = 60, 15, 6
HIDDEN = ("friction", "gain")
"""What the photos of one camera can show. Play they cannot: gravity keeps the gear on one side wherever the board is
seen, so it is a part of the zero."""
SPEED_DEG_S, DWELL_S = "180", "1"
CANDIDATES = 240
SHOULDER, FAR = 1, np.radians(24.0)
AROUND = np.radians(4.0) * np.vstack([np.zeros(ARM.dof), np.eye(ARM.dof), -np.eye(ARM.dof)])
"""rad: the true arm, and other models' commands, are beside the arm as drawn."""
TIME = f"""\
Time: the simulated servos' clock runs {SPEED:g} times as fast as the computer's, and the arm is driven at {SPEED_DEG_S}
deg/s; yours is driven at 30 unless you say otherwise. The pictures are rendered, with blur and noise; the board in them
is found by the detector that will find yours."""


def run_demo(folder: Path, seed: int, photos: int = PHOTOS, goals: int = GOALS) -> None:
    """Runs all steps and prints the table at the end. Raises `LrmError`."""
    began, effect = time.monotonic(), HIDDEN[seed % len(HIDDEN)]
    show(heading(f"Seed {seed}: `make demo ARM=so101 SEED={seed}` runs the same demo again."), TIME)
    for old in ("measured.photos", "lens-photos"):
        shutil.rmtree(folder / old, ignore_errors=True)
    write_lens_photos(folder / "lens-photos", SCENE, LENS_PHOTOS)
    with (
        tempfile.TemporaryDirectory(prefix="lrm-so101-") as private,
        simulated_so101(Path(private), effect, seed) as link,
        simulated_camera(link) as camera,
    ):
        driven = ("--robot", f"feetech:{link}", "--speed", SPEED_DEG_S)
        tracker = ("--tracker", f"camera:{camera},{folder / 'measured.camera.toml'}", "--dwell", DWELL_S)
        steps = DemoSteps(folder, (*driven, *tracker), seed, str(folder / "goals.csv"), timing=("--settle", "0.05"))
        poses = poses_for_photos(photos, seed)
        steps.write_poses(table("q{}_deg", np.degrees(poses)))
        (folder / "goals.csv").write_text(table("xyz", 1e3 * goals_in_view(poses, goals, seed)), encoding="utf-8")
        steps.calibrate_camera("lens-photos")
        steps.photograph(camera, "so101", *driven)
        results = {"none, the arm as drawn": steps.verify("nominal")}
        steps.fit()
        results["fitted"] = steps.verify("fitted", "--model", steps.file("fitted.toml"))
        named, last = steps.diagnose(), "fitted.toml"
        if named.to_add:
            steps.add(named.name)
            last = "better.toml"
            results["with the effect"] = steps.verify("better", "--model", steps.file(last))
        reported = steps.report(last)
    truth, seconds = DemoTruth(seed, *NAMED[effect], SIMPLER.get(effect, "")), time.monotonic() - began
    noise_mm = camera_noise_mm(results.values())
    conclude(folder, truth, named, results, "commands corrected by", noise_mm, seconds, reported)
    show_motion(folder, seed)


def camera_noise_mm(results: Iterable[Mapping[str, Any]]) -> float:
    """RMS error of the tip (mm) that the scatter of the photos of a rest leaves of their mean."""
    per_axis = [goal["measured_sd_mm"] for result in results for goal in result["goals"]]
    return math.sqrt(3.0) * float(np.sqrt(np.mean(np.square(per_axis))))


def table(name: str, values: Array) -> str:
    """A CSV of rows: numbered poses whose columns are `name` with the joints' numbers, or goals `x_mm, y_mm, z_mm`."""
    rows = [",".join(f"{value:.4f}" for value in row) for row in values]
    if name == "xyz":
        return "\n".join(["x_mm,y_mm,z_mm", *rows]) + "\n"
    header = ",".join(["pose", *(name.format(i + 1) for i in range(values.shape[1]))])
    return "\n".join([header, *(f"{number},{row}" for number, row in enumerate(rows, start=1))]) + "\n"


def goals_in_view(poses: Array, count: int, seed: int) -> Array:
    """(count, 3), goals of the tip (m) at which the camera sees the board on the arm as drawn.

    Of the angles that lead to a goal the arm takes the nearest: from the last of the poses (P, n), rad, on, and in the
    next round from the last of the goals on. The shoulder moves far: inverse kinematics knows the direction of a move,
    not what friction remembers of those before.
    """
    solver, left = ModelSolver.of(None, ARM, tuple), list(poses_for_photos(CANDIDATES, seed + CANDIDATES)[::2])
    goals, near = list[Array](), poses[-1]
    while len(goals) < count and (far := [k for k, q in enumerate(left) if abs(q[SHOULDER] - near[SHOULDER]) > FAR]):
        angles = left.pop(min(far, key=lambda k: float(np.abs(left[k] - near).max())))
        tried = [*goals, solve_equilibrium(model_of(ARM, ()), poses_of(angles)).tcp[0]]
        if _seen_all_the_way(solver, [*tried, *tried], poses[-1]):
            goals, near = tried, angles
    if len(goals) < count:
        raise LrmError(f"{len(goals)} goals that the camera sees were found with seed {seed}, {count} are needed")
    return np.array(goals)


def _seen_all_the_way(solver: ModelSolver, goals: Sequence[Array], near: Array) -> bool:
    for goal in goals:
        command = solver.solve(point(goal), near.tolist(), 0.0)
        if not isinstance(command, GoalCommand):
            return False
        near = np.array(command.q)
        if not DRAWN.shows(near + AROUND).all():
            return False
    return True


def main(argv: list[str] | None = None) -> int:
    """Runs the demo. Exit code 0, or 2 with one line that says what failed."""
    return run_in_folder("examples.so101.demo", __doc__ or "", run_demo, argv)


if __name__ == "__main__":
    sys.exit(main())
