"""An arm that stands at each pose of a plan while somebody takes a photo, and what was commanded there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

from lrm_ident.data.measurement_file.write import StatedQuantity, csv_text, quantity_columns
from lrm_ident.measuring.campaign.data_file import ArmState
from lrm_ident.measuring.campaign.plan import PlannedPose, lightest
from lrm_ident.measuring.campaign.run import Clock, PoseTiming, Unreachable
from lrm_ident.measuring.campaign.session import DrivenArm, Loads, OpenArm
from lrm_math.arm.arm import Arm
from lrm_math.errors import LrmError


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
class PhotoOrder:
    """Order to drive through a plan. `drive`, `loads`: as of `CampaignOrder`.

    `take`: takes the photo of that number, from 1. `on_photo`: called with all so far, after each.
    """

    drive: OpenArm
    arm: Arm
    clock: Clock
    timing: PoseTiming
    loads: Loads
    take: Callable[[int], object]
    on_photo: Callable[[PhotographedPoses], object]
    on_progress: Callable[[str], object]


def photograph(order: PhotoOrder, plan: Sequence[PlannedPose]) -> PhotographedPoses:
    """Stands at every pose of a plan, and has its photo taken. Raises `LrmError`."""
    found, payload = PhotographedPoses(), None
    rest = lightest(plan, order.arm)
    opened: AbstractContextManager[DrivenArm] = order.drive(order.clock, order.loads)
    with opened as driven:
        if driven.joints != order.arm.dof:
            raise LrmError(f"{order.arm.name} has {order.arm.dof} joints, {driven.robot} has {driven.joints}")
        for pose in plan:
            if pose.payload != payload:
                driven.arm.change_payload(pose.payload)
                payload = pose.payload
            if why := driven.arm.too_warm():
                order.on_progress(f"pose {pose.number}: {why}: cooling")
                driven.arm.cool(rest)
            _at(order, driven, pose, found)
    return found


def _at(order: PhotoOrder, driven: DrivenArm, pose: PlannedPose, found: PhotographedPoses) -> None:
    why = ""
    for _ in range(order.timing.attempts):
        try:
            state = driven.arm.go(pose)
        except Unreachable as error:
            why = str(error)
            break
        order.clock.sleep(order.timing.settle)
        order.take(len(found.poses) + 1)
        if not (why := driven.arm.disturbed()):
            found.poses.append(pose)
            found.states.append(state)
            order.on_photo(found)
            return
    found.failed[pose.number] = why
    order.on_progress(f"pose {pose.number}: no photo: {why}")
