"""`lrm skill`: one step of a fetch, waited for."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any

from lrm_math.errors import LrmError
from lrm_math.number_list import parse_numbers
from lrmd.cli.motion import three_angles
from lrmd.cli.parsing import joint_angles, lease_holder, open_rover, parse_angle, payload_kg, place_m
from lrmd.client import Rover
from lrmd.messages.kinematics import FkRequest, GoalEntry
from lrmd.messages.surroundings import ContactEntry

REGION_M, BELOW_M, ABOVE_M = 0.035, 0.02, 0.1
"""m: half the width of the place where bodies may touch, and how far it reaches below and above the goal."""


def skill(o: argparse.Namespace) -> int:
    """Carries out a skill; Ctrl-C holds. Returns the exit code: 1 if it did not reach its end."""
    with open_rover(o) as rover, rover.control(lease_holder(), o.take):
        fields = _fields(o, rover)
        try:
            state = rover.skill(o.name, **fields)
        except KeyboardInterrupt:
            rover.hold()
            print("held", file=sys.stderr)
            return 1
    print(f"{state.skill}: {state.outcome}: {state.text}")
    return 0 if state.outcome == "reached" else 1


def _fields(o: argparse.Namespace, rover: Rover) -> dict[str, Any]:
    """Fields of the request that the options give. Raises `LrmError`."""
    given: dict[str, Any] = {
        "goal": None if o.goal is None else _goal(o),
        "height_m": None if o.height_mm is None else o.height_mm / 1000,
        "q_rad": list(joint_angles(rover, o.q).values()) if o.q else None,
        "gripper_rad": parse_angle(o.gripper) if o.gripper else None,
        "payload_kg": payload_kg(o),
        "payload_centre_m": None if o.payload_centre_mm is None else [v / 1000 for v in o.payload_centre_mm],
        "listen_s": o.listen,
        "speed": o.speed,
    }
    fields = {name: value for name, value in given.items() if value is not None}
    if o.touch:
        fields["may_touch"] = [_contact(words, _middle(o, rover)) for words in o.touch]
    return fields


def _goal(o: argparse.Namespace) -> GoalEntry:
    """The goal in the options."""
    return GoalEntry(
        position_m=place_m("--goal", o.goal),
        rpy_rad=three_angles(o.rpy) if o.rpy else None,
        approach=parse_numbers("--approach", o.approach, "three numbers by commas", 3) if o.approach else None,
    )


def _middle(o: argparse.Namespace, rover: Rover) -> list[float]:
    """Where bodies may touch (m): at the goal, or else where the tool is."""
    if o.goal is not None:
        return place_m("--goal", o.goal)
    return rover.fk(FkRequest(q_rad=[rover.commanded_q()])).places[0].tcp_m


def _contact(words: Sequence[str], place: Sequence[float]) -> ContactEntry:
    """A contact that is permitted near a place (m). Raises `LrmError`."""
    first, second, depth = words
    try:
        millimetres = float(depth)
    except ValueError:
        raise LrmError(f"--touch {' '.join(words)}: '{depth}' should be a number of mm") from None
    x, y, z = place
    return ContactEntry(
        first=first, second=second, low_m=[x - REGION_M, y - REGION_M, z - BELOW_M],
        high_m=[x + REGION_M, y + REGION_M, z + ABOVE_M], depth_m=millimetres / 1000,
    )  # fmt: skip
