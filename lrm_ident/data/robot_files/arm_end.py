"""Where a robot's arm ends: at its only tip, or before the gripper that it carries.

A gripper's joints open and close: they do not move the tip of the arm, and recordings give them in percent.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from lrm_ident.data.robot_files.urdf import Urdf, UrdfJoint
from lrm_math.errors import FileError

JAW = re.compile("gripper|jaw|finger|knuckle|claw|mors", re.IGNORECASE)
SLIDES = "prismatic"


def choose_tip(robot: Urdf, base: str) -> str:
    """The only end of a robot's arm. Raises `FileError` if there are several: they are listed with their joints."""
    counts, carriers = dict[str, int](), set[str]()
    for tip in robot.tips:
        try:
            path = robot.chain(base, tip)
        except FileError:
            continue
        kept = path[: _gripper_from(robot, path)]
        end = kept[-1].child if kept else base
        counts[end] = sum(joint.turns for joint in kept)
        carriers.update(joint.parent for joint in kept)
    counts = {end: count for end, count in counts.items() if end not in carriers}
    moving = {end: count for end, count in counts.items() if count} or counts
    if len(moving) != 1:
        listed = ", ".join(f"{end} ({count} joints)" for end, count in moving.items())
        raise FileError(robot.path, "", f"has {len(moving)} tips", f"name the measured one with --tip: {listed}")
    return next(iter(moving))


def gripper_notices(robot: Urdf, tip: str) -> Iterator[str]:
    """What a person should know of an arm's end that was chosen: the gripper whose joints begin there."""
    names = [joint.name for joint in robot.joints.values() if joint.parent == tip and joint.kind != "fixed"]
    if names:
        whose = f"joint {names[0]} is" if len(names) == 1 else f"joints {', '.join(names)} are"
        farther = next(end for end in robot.tips if any(joint.parent == tip for joint in robot.chain(robot.root, end)))
        yield f"{whose} the gripper's: the arm ends at {tip} (else: --tip {farther})"


def _gripper_from(robot: Urdf, path: Sequence[UrdfJoint]) -> int:
    """Number of the first joint of a gripper on the way to a tip; `len(path)`: none is."""
    first, moving = len(path), [k for k, joint in enumerate(path) if joint.kind != "fixed"]
    for k in reversed(moving):
        if not any(path[j].turns for j in moving if j < k) or not _opens(robot, path, k, first):
            break
        first = k
    return first


def _opens(robot: Urdf, path: Sequence[UrdfJoint], k: int, first: int) -> bool:
    """Whether the joint `k` opens a gripper; from the joint `first` on all do."""
    joint = path[k]
    named = bool(JAW.search(joint.name) or JAW.search(joint.child))
    if joint.kind == SLIDES:
        beside = [other for other in robot.joints.values() if other.parent == joint.parent and other.kind == SLIDES]
        return named or len(beside) > 1
    if joint.mimic is not None:
        others = {other.name for other in robot.joints.values()} - {joint.name}  # to follow none of them is a fault
        if named or joint.mimic.leader in others - {before.name for before in path[:k]}:
            return True
    followers = [other for other in robot.joints.values() if other.mimic and other.mimic.leader == joint.name]
    if any(other.parent == joint.parent for other in followers if other not in path):
        return True  # one finger's motor moves the other finger too
    return bool(JAW.search(joint.name)) and (k == len(path) - 1 or first < len(path))
