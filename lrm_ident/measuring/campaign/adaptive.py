"""Adaptive measuring: a batch of poses, then a fit and a diagnosis, until enough is known."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.wording import in_mm
from lrm_ident.design.adaptive_batch import (
    BATCH,
    FIRST_BATCH,
    AdaptiveFindings,
    StoppingGoal,
    assess,
    first_rows,
    next_rows,
    random_poses_as_good,
)
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.measuring.campaign.data_file import DataFile
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.run import CampaignResult, PoseCampaign
from lrm_math.arm.arm import Arm
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses, poses_of

REPEATED = 8
"""One pose in so many is measured twice: what differs then is noise."""


@dataclass
class AdaptiveCampaign:
    """A campaign that measures of a plan only what it needs.

    `arm`: whose model is fitted. `say`: called with what is known after a batch. The poses that the file has are enough
    to go on after an interruption.
    """

    campaign: PoseCampaign
    arm: Arm
    goal: StoppingGoal
    say: Callable[[str], object]
    seed: int = 0

    def run(self, plan: Sequence[PlannedPose], file: DataFile) -> CampaignResult:
        """Measures until the goal is reached, or all of the plan is. Raises what ends it before."""
        result = CampaignResult()
        before: AdaptiveFindings | None = None
        while True:
            offered = [pose for pose in plan if _is_left(pose, file, result)]
            findings = self._assess(file) if len(file.done) >= FIRST_BATCH else None
            if findings is not None:
                self.say(f"{len(file.done)} poses: {findings_words(findings)}")
                # a name that comes and goes is not sure
                same = before is not None and sorted(before.named) == sorted(findings.named)
                if findings.reached(self.goal) and (same or not self.goal.explain):
                    self.say(self._saved(findings, plan, file))
                    return result
            before = findings
            if not offered:
                self.say("every pose of the plan was driven to, and that is not enough; offer more poses")
                return result
            batch = self._batch(findings, offered, file)
            part = self.campaign.run([*batch, *repeats_of(batch, plan, file)], file)
            result.failed |= part.failed
            result.repeated += part.repeated

    def _assess(self, file: DataFile) -> AdaptiveFindings | None:
        try:
            return assess(load_measurements(file.path, self.arm))
        except LrmError as error:
            self.say(f"{len(file.done)} poses: {error}")
            return None

    def _batch(
        self, findings: AdaptiveFindings | None, offered: Sequence[PlannedPose], file: DataFile
    ) -> list[PlannedPose]:
        """The next poses, load by load, in random order: drifts then look like nothing else."""
        rng, poses = np.random.default_rng([self.seed, len(file.done)]), _poses(offered)
        measured = load_measurements(file.path, self.arm).poses if file.done else None
        if findings is None or measured is None:
            count = max(FIRST_BATCH - len(file.done), BATCH)
            rows = first_rows(nominal_model(self.arm), measured, poses, count, self.seed)
        else:
            rows = next_rows(findings, measured, poses, BATCH, self.seed)
        chosen = [offered[row] for row in rng.permutation(rows).tolist()]
        return sorted(chosen, key=lambda pose: pose.payload)

    def _saved(self, findings: AdaptiveFindings, plan: Sequence[PlannedPose], file: DataFile) -> str:
        count, every = len(file.done), _poses(plan)
        random = random_poses_as_good(findings, load_measurements(file.path, self.arm).poses, every, self.seed)
        words = f"{count} poses are enough, {len(plan)} were offered"
        if random is None:
            return f"{words}; all of these, without this choice, would be expected to determine less"
        saved = f": {random - count} saved" if random > count else ""
        return f"{words}; drawn at random, about {random} would be expected to determine as much{saved}"


def findings_words(findings: AdaptiveFindings) -> str:
    """Knowledge so far, in a line."""
    names = "; ".join(
        names[0] if len(names) == 1 else f"{names[0]} or {', '.join(names[1:])}" for names in findings.named
    )
    error = f"held-out error {in_mm(findings.held_out)} mm RMS, with 95 % below {in_mm(findings.bound)}"
    return f"{error}; {f'added {names}' if names else 'nothing added'}; {findings.verdict.replace('_', ' ')}"


def repeats_of(batch: Sequence[PlannedPose], plan: Sequence[PlannedPose], file: DataFile) -> Iterator[PlannedPose]:
    """Some poses of a batch again, at its end, with numbers after all that there are."""
    number = max([pose.number for pose in plan] + file.done)
    for pose in batch[::REPEATED]:
        number += 1
        yield replace(pose, number=number, repeat_of=pose.number)


def _is_left(pose: PlannedPose, file: DataFile, result: CampaignResult) -> bool:
    """Whether a pose was not measured, nor in vain; repeats of the plan are not needed, those of a batch are."""
    return pose.repeat_of == pose.number and pose.number not in file.done and pose.number not in result.failed


def _poses(planned: Sequence[PlannedPose]) -> Poses:
    return poses_of(np.array([pose.q for pose in planned]), np.array([pose.payload for pose in planned]))
