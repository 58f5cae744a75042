"""An arm that stands at each pose of a plan while somebody takes a photo, and what was commanded there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from lrm_ident.data.measurement_file.pose_quantity import StatedQuantity
from lrm_ident.data.measurement_file.write import csv_text, quantity_columns
from lrm_ident.measuring.campaign.data_file import ArmState
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.run import CampaignArm, Clock, PoseTiming, Unreachable, held


@dataclass
class PhotographedPoses:
    """Poses of which there is a photo: as planned, and as commanded. `failed`: numbers of others, and why."""

    poses: list[PlannedPose] = field(default_factory=list)
    states: list[ArmState] = field(default_factory=list)
    failed: dict[int, str] = field(default_factory=dict)

    def csv(self) -> str:
        """CSV text of the poses, in the order of their photos."""
        sides = [state.direction for state in self.states]
        stated: list[StatedQuantity] = [
            ("pose", [pose.number for pose in self.poses], 0),
            ("angles", [state.q for state in self.states], 9),
            ("payload", [pose.payload for pose in self.poses], 4),
            ("session", [state.session for state in self.states], 0),
            ("sides", sides if any(any(pose.approach) for pose in self.poses) else None, 0),
        ]
        return csv_text(quantity_columns(stated))


@dataclass(frozen=True)
class PhotoCampaign:
    """Parts that poses are photographed with. `rest`: where the arm cools.

    `take`: takes the photo of that number, from 1. `on_photo`: called with all so far, after each.
    """

    arm: CampaignArm
    clock: Clock
    timing: PoseTiming
    rest: PlannedPose
    take: Callable[[int], object]
    on_photo: Callable[[PhotographedPoses], object]
    on_progress: Callable[[str], object]

    def run(self, plan: Sequence[PlannedPose]) -> PhotographedPoses:
        """Stands at every pose of a plan, and has its photo taken. Raises `LrmError`."""
        photographed, payload = PhotographedPoses(), None
        for pose in plan:
            if pose.payload != payload:
                self.arm.change_payload(pose.payload)
                payload = pose.payload
            if why := self.arm.too_warm():
                self.on_progress(f"pose {pose.number}: {why}: cooling")
                self.arm.cool(self.rest)
            if why := self._at(pose, photographed):
                photographed.failed[pose.number] = why
                self.on_progress(f"pose {pose.number}: no photo: {why}")
        return photographed

    def _at(self, pose: PlannedPose, photographed: PhotographedPoses) -> str:
        """Has the photo of one pose taken; why there is none, else empty."""
        why = ""
        for _ in range(self.timing.attempts):
            try:
                state = self.arm.go(pose)
            except Unreachable as error:
                return str(error)
            self.clock.sleep(held(self.timing, pose).settle)
            self.take(len(photographed.poses) + 1)
            if not (why := self.arm.disturbed()):
                photographed.poses.append(pose)
                photographed.states.append(state)
                self.on_photo(photographed)
                break
        return why
