"""One case on one arm through the functions behind `auto`, and what came out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.auto import run_auto
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_math.arm.arm_file import load_arm as load_tool_arm
from lrm_math.arrays import Array
from lrm_math.effects import EffectRef, effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.model import model_of
from validation.hidden_effects.case_generator import stable_seed
from validation.hidden_effects.data import ARM_FILE, FLOOR_M, LOADS_KG, NOISE_M
from validation.hidden_effects.faults.measurement import FaultCase, HealthyMeasurement
from validation.hidden_effects.unfamiliar_data import ARMS
from validation.synthetic import GroundTruth, even_schedule, load_arm, measure, random_poses
from validation.synthetic import base_displacement_to_deviations as as_deviations
from validation.synthetic.generate import directions

FIRST_SEED = {"tune": 3000, "report": 4000}
ALWAYS_TRUE = ("offsets", "compliance")
NEAR_NOISE = 1.15
LAB = "lrm-lab"


def arm_file(arm: str) -> Path:
    """The description of an arm of the catalogues."""
    return ARM_FILE if arm == LAB else ARMS / f"{arm}.toml"


@dataclass(frozen=True)
class FaultOutcome:
    """The steps of `auto`, each with its class, which of them are findings, the verdict of the report, and what is left
    over the noise. Offsets and compliances that a step adds are always there, and not counted."""

    case: FaultCase
    arm: str
    right: tuple[str, ...]
    steps: tuple[tuple[str, ...], ...]
    findings: tuple[bool, ...]
    verdict: str
    ratio: float

    @property
    def false_names(self) -> tuple[str, ...]:
        """First names of steps in whose class nothing is right."""
        return tuple(step[0] for step in self._new if not set(step) & set(self.right))

    @property
    def false_findings(self) -> tuple[str, ...]:
        """Those of them that are said to be findings."""
        said = {step[0] for step, finding in zip(self.steps, self.findings, strict=True) if finding}
        return tuple(name for name in self.false_names if name in said)

    @property
    def honest_findings(self) -> bool:
        """The same of what is said to be a cause: descriptions name none."""
        found = [step for step, finding in zip(self.steps, self.findings, strict=True) if finding]
        return replace(self, steps=tuple(found), findings=(True,) * len(found)).honest

    @property
    def honest(self) -> bool:
        """Whether the first name is right, or where nothing is named the verdict an honest one: *nothing is missing*
        is one beside no more than the noise."""
        if self._new:
            return bool(set(self._new[0]) & set(self.right))
        content = self.verdict == "nothing_missing" and self.ratio <= NEAR_NOISE
        return content or self.verdict in self.case.verdicts

    @property
    def _new(self) -> list[tuple[str, ...]]:
        return [step for step in self.steps if EffectRef.parse(step[0]).id not in ALWAYS_TRUE]


def examine(case: FaultCase, arm: str, half: str, number: int, poses: int) -> FaultOutcome:
    """Simulates a measurement, spoils it, and follows `auto`."""
    data, right = spoiled(case, arm, FIRST_SEED[half] + number, poses)
    drawn = load_tool_arm(arm_file(arm))
    model = model_of(drawn, effects_at(drawn, "offsets") + effects_at(drawn, "compliance"))
    try:
        run = run_auto(fit_identifiable(model, data, model.keys).fit.model, data)
        verdict, attributions = run.report.verdict, run.attributions
    except LrmError as error:
        return FaultOutcome(case, arm, right, (), (), str(error), np.nan)
    steps = tuple(step.names for step in run.steps[1:])
    findings = tuple(one.kind == "finding" for one in attributions)
    return FaultOutcome(case, arm, right, steps, findings, verdict, run.steps[-1].fit.sigma / NOISE_M)


def spoiled(case: FaultCase, arm: str, seed: int, count: int) -> tuple[Measurements, tuple[str, ...]]:
    """The measurement with the fault, and the names that are right for it."""
    described, fixed = load_arm(arm_file(arm)), stable_seed(case.name, seed, "fault")
    truth = as_deviations(described, GroundTruth.random(described, seed, ()))
    q, rng = random_poses(described, count, seed, floor_m=FLOOR_M), np.random.default_rng(fixed)
    plan, load = even_schedule(*q.shape), rng.choice(LOADS_KG, count)

    def at(angles: Array) -> Array:
        return measure(described, truth, angles, load, NOISE_M, seed, plan)

    found = case.spoil(HealthyMeasurement(q, load, at(q), at, rng))
    written, carried = q if found.q is None else found.q, load if found.load is None else found.load
    noise, pose = NOISE_M if case.noise_known else None, np.arange(1, count + 1)
    came = directions(written, np.zeros(q.shape[1]))
    poses = Poses(written, carried, came, plan.time_s, found.session, number=pose)
    return Measurements(poses, pose, found.tcp, None, noise, pose, Path("simulated.csv"), ""), found.right
