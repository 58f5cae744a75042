"""Imports every robot's file below some folders, as `arm import` does, and compares the arms with MuJoCo.

    python -m validation.vendor_arms FOLDER [FOLDER …] [--all] [--xacro NAME:=VALUE …] [--accept RULE …]

A folder is a copy of a vendor's repository; docs/vendor-arms.md names some. Where a file has several tips, the one with
most joints is named, as the message advises. Printed for each folder: files that are imported, those refused by reason,
and the largest difference of positions (m) and of gravity's torques (N·m) from MuJoCo's at random angles.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from lrm_ident.data.robot_files.mjcf_robot import read_robot
from lrm_ident.data.robot_files.urdf_arm import import_arm
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from validation.options import asked
from validation.runner import run_cases
from validation.tables import markdown_table
from validation.vendor_arms.mujoco_robot import MujocoRobot

ENDINGS = ".urdf", ".xacro", ".xml"
ROBOT = re.compile(rb"<(robot|mujoco)[\s>]")
TIPS = re.compile(r"(\S+) \((\d+) joints\)")
POSES = 5
KINDS = {
    "no robot in it": "has no <link>|0 joints between|macro name|not found in actuator|unknown default class",
    "a gripper, wheel or another part": "mm long|centre of mass",
    "needs a value of a xacro argument": "--xacro NAME|Invalid parameter|Undefined parameters|is not defined",
    "refers to a file or package that is not there": "package not found|No such file",
    "a joint that slides or floats": "is prismatic|is floating|is planar|is ball",
    "more joints than 16": "joints between base and tip",
    "meshes that masses are computed from, not in this copy": "no mesh",
    "masses that no arm of its size has": "masses look",
    "couplings of a gripper": "follows joint|that follows it",
    "not valid": "not valid XML|is there twice|no link|links have no parent|lower < upper|is none",
}
"""Reasons of refusals by words of their messages, all of them right by what the file states."""


@dataclass(frozen=True)
class VendorArm:
    """What became of one file: `refused` in words ("": imported), and how far it is from MuJoCo's (m, N·m)."""

    path: Path
    refused: str = ""
    tip: str = ""
    position: float = float("nan")
    torque: float = float("nan")


COLUMNS = ("files of", "ending", "files", "imported", "of them with `--tip`", "position, m", "torque, N m", "refused")


def main() -> None:
    """Reads the options, runs, prints."""
    options = asked(
        __doc__,
        "folders+",
        all=(False, "print every file that is refused"),
        xacro=([str], "arguments of xacro files, NAME:=VALUE"),
        accept=([str], "of a copy without meshes: mass"),
        jobs=1,
    )
    files = {str(path): path for folder in options.folders for path in robot_files(folder)}
    examine = partial(imported, arguments=dict(word.split(":=", 1) for word in options.xacro), accept=options.accept)
    found = run_cases(files, examine, line, options.jobs)
    groups = {
        (folder, ending): [one for one in found.values() if one.path.is_relative_to(folder) and _ending(one) == ending]
        for folder in options.folders
        for ending in ENDINGS
    }
    rows = [(folder.name.replace("+", "/"), ending, *cells(some)) for (folder, ending), some in groups.items() if some]
    print(markdown_table(COLUMNS, rows))
    for key, one in found.items() if options.all else ():
        if one.refused:
            print(f"    {line(key, one)}")


def line(key: str, one: VendorArm) -> str:
    """What became of one file."""
    return f"{key}: {f'{kind_of(one.refused)}: {one.refused}' if one.refused else 'imported'}"


def _ending(one: VendorArm) -> str:
    return one.path.suffix.lower()


def robot_files(folder: Path) -> Iterator[Path]:
    """Files below a folder that begin a robot, by its first element."""
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() in ENDINGS and path.is_file() and ROBOT.search(path.read_bytes().replace(b"\0", b"")):
            yield path


def imported(path: Path, arguments: Mapping[str, str], accept: Collection[str] = ()) -> VendorArm:
    """Imports one file; a tip that has to be named is that with most joints."""
    try:
        robot, tip = read_robot(path, arguments), ""
        try:
            found = import_arm(robot, accept=accept)
        except LrmError as error:
            tips = TIPS.findall(str(error).partition("--tip: ")[2])
            if not tips:
                raise
            tip = max(tips, key=lambda one: int(one[1]))[0]
            found = import_arm(robot, tip=tip, accept=accept)
    except LrmError as error:
        return VendorArm(path, " ".join(str(error).replace(f"{path}: ", "").split()))
    peer, q = MujocoRobot.of(path, robot, found), np.random.default_rng(1).uniform(-1.0, 1.0, (POSES, found.arm.dof))
    ours = solve_equilibrium(model_of(found.arm, ()), poses_of(q))
    positions, torques = zip(*(peer.moved(angles) for angles in q), strict=True)
    apart = float(np.abs(ours.tcp - np.array(positions)).max())
    return VendorArm(path, tip=tip, position=apart, torque=float(np.abs(ours.joint_torque - np.array(torques)).max()))


def kind_of(refused: str) -> str:
    """The kind of a refusal, by its message."""
    return next((kind for kind, words in KINDS.items() if re.search(words, refused)), "other")


def cells(found: Sequence[VendorArm]) -> tuple[object, ...]:
    """One line of the table."""
    good = [one for one in found if not one.refused]
    position, torque = (max((getattr(one, key) for one in good), default=0.0) for key in ("position", "torque"))
    why = Counter(kind_of(one.refused) for one in found if one.refused)
    said = ", ".join(f"{count} {kind}" for kind, count in why.most_common())
    return len(found), len(good), sum(bool(one.tip) for one in good), f"{position:.0e}", f"{torque:.0e}", said


if __name__ == "__main__":
    main()
