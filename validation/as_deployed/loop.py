"""One loop: measure, fit, name, deploy, and send the tip to goals, where the true arm says where it lands.

Poses and the tracker's noise are those of the demo, which runs the same by its commands and daemon. A goal leaves three
joints free, and the inverse takes the command nearest to where the arm comes from: all models answer each goal from the
same random pose, or the way through the goals would decide more than the model does.
"""

from __future__ import annotations

import math
import tempfile
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from examples.demo.pose_files import LOAD_G, clear_poses
from examples.demo.simulated_tracker import FRAME_SD_M, REST_SD_M
from examples.demo.world import ARM
from lrm_ident.data.error_stats import error_stats
from lrm_ident.measuring.verification.goals import draw_goals
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import GRAM, load_arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.answer import Solved
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.goal import point
from lrm_math.model.deployed_model import as_deployed
from lrm_math.model.model import Model
from validation.as_deployed.outcome import Record, steps_of
from validation.as_deployed.passing_world import PUSHED_AT_S, PassingWorld
from validation.as_deployed.recording import WorldRecording
from validation.synthetic import ArmDescription, Dataset, GroundTruth, Schedule, true_state
from validation.synthetic.example import ARM_FILE

POSES, GOALS, PACE_S = 160, 36, 4.5
NOISE_M = math.hypot(REST_SD_M, FRAME_SD_M)


@dataclass(frozen=True)
class InstantLoop:
    """The loop of a seed."""

    seed: int

    @cached_property
    def world(self) -> PassingWorld:
        """Its causes."""
        return PassingWorld(self.seed)

    def record(self) -> Record:
        """RMS distance from the goals in mm: with the plain fit, after `auto`, and with all causes known. Never raises
        `LrmError`."""
        began = time.perf_counter()
        try:
            record = self._record()
        except LrmError as problem:
            record = {"trouble": str(problem)}
        return {"hidden": self.world.hidden, **record, "seconds": round(time.perf_counter() - began, 1)}

    def _record(self) -> Record:
        world = self.world
        plain = self._fitted(*world.passing, PUSHED_AT_S)
        found, named = plain.auto()
        known = self._fitted(*world.level, 0.0)
        models = {"before": (plain, world.lasting), "after": (named, world.lasting), "floor": (known, world.level)}
        errors = {when: self._errors(as_deployed(study.model), *then) for when, (study, then) in models.items()}
        reached = np.isfinite(np.stack([*errors.values()])).all(axis=(0, 2))
        figures = {f"{when}_mm": float(f"{1e3 * error_stats(of[reached]).rms:.4g}") for when, of in errors.items()}
        return {**figures, "goals": int(reached.sum()), "steps": steps_of(found), "verdict": found.verdict}

    def _fitted(self, arm: ArmDescription, truth: GroundTruth, pushed_at_s: float) -> Study:
        """The plain fit to all poses, measured one after the other."""
        q = clear_poses(load_arm(ARM), POSES, np.random.default_rng([self.seed, 7]))
        load = np.where(np.arange(POSES) < POSES // 2, 0.0, LOAD_G * GRAM)
        plan = Schedule(PACE_S * np.arange(1.0, POSES + 1.0), np.ones(POSES), np.zeros(q.shape[1]))
        tips = true_state(arm, truth, q, load, plan).tcp_m
        seen = np.where(plan.time_s[:, None] < pushed_at_s, tips, self.world.pushed(tips))
        tcp = seen + NOISE_M * np.random.default_rng([self.seed, 99]).normal(size=seen.shape)
        whole = Dataset(arm, truth, plan, q, load, tcp, NOISE_M, self.seed)
        with tempfile.TemporaryDirectory(prefix="as-deployed-") as folder:
            data = WorldRecording(ARM_FILE, whole, POSES, tcp).load(Path(folder))[0]
        return Study.of(data).fit()

    def _errors(self, model: Model, arm: ArmDescription, truth: GroundTruth) -> Array:
        """(GOALS, 3), how far from the goals the tip lands afterwards (m); NaN where there is no command."""
        solver, drawn = CalibratedSolver.of(model), load_arm(ARM)
        starts = clear_poses(drawn, GOALS, np.random.default_rng([self.seed, 8]))
        load, missed = np.array([LOAD_G * GRAM]), np.full((GOALS, 3), np.nan)
        for row, (goal, start) in enumerate(zip(draw_goals(drawn, GOALS, self.seed), starts, strict=True)):
            reply = solver.solve(point(goal), float(load[0]), start.tolist())
            if isinstance(reply, Solved):
                tip = true_state(arm, truth, np.array([reply.q]), load).tcp_m[0]
                missed[row] = self.world.pushed(tip) - goal
        return missed
