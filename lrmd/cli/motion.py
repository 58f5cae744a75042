"""The commands of `lrm` that switch servos on and off and move them to angles."""

from __future__ import annotations

import argparse
import getpass
import math
import sys
from collections.abc import Mapping, Sequence

from lrm_math.errors import LrmError
from lrmd.cli.parsing import joint_angles, lease_holder, open_rover, parse_angles, payload_kg, servo_angles
from lrmd.client import RequestRefused, Rover


def arm(o: argparse.Namespace) -> int:
    """`lrm arm`: switches servos on."""
    with open_rover(o) as rover, rover.control(lease_holder(), o.take):
        try:
            if o.q or o.at:
                rover.arm("given", joint_angles(rover, o.q) if o.q else servo_angles(rover, o.at), o.servo)
            else:
                rover.arm("stored" if o.stored else "board", servos=o.servo)
        except RequestRefused as error:
            if error.code != "pose_needed":
                raise
            raise LrmError(f"{error}{_stored_hint(error.detail)}") from None
        on = [n for n, is_on in zip(rover.joints().names, rover.joints().on, strict=True) if is_on]
        print(f"armed: {', '.join(on)}")
    return 0


def _stored_hint(detail: Mapping[str, object]) -> str:
    stored = detail.get("stored_rad")
    if not isinstance(stored, dict) or not stored:
        return " (no pose is stored)"
    pose = ", ".join(f"{n} {math.degrees(q):.1f}" for n, q in stored.items())
    return f". Stored (deg): {pose}" + ("" if detail.get("stored_still") else "; but it was moving then")


def move(o: argparse.Namespace) -> int:
    """`lrm move`: moves servos by name or number."""
    with open_rover(o) as rover:
        targets = joint_angles(rover, o.q) if o.q else {}
        targets |= servo_angles(rover, [(f"joint{n.removeprefix('joint')}", a) for n, a in o.joint] + o.servo)
        if not targets:
            raise LrmError("move: nothing to move; give --joint N ANGLE, --servo NAME ANGLE or --q")
        return run_motion(o, rover, [targets], payload_kg(o))


def gripper(o: argparse.Namespace) -> int:
    """`lrm gripper`: moves the gripper."""
    with open_rover(o) as rover:
        return run_motion(o, rover, [servo_angles(rover, [("gripper", o.angle)])])


def pan_tilt(o: argparse.Namespace) -> int:
    """`lrm pan-tilt`: moves the camera."""
    with open_rover(o) as rover:
        return run_motion(o, rover, [servo_angles(rover, [("pan", o.pan), ("tilt", o.tilt)])])


def run_motion(
    o: argparse.Namespace, rover: Rover, waypoints: Sequence[Mapping[str, float]], payload: float | None = None
) -> int:
    """Moves through `waypoints` (rad) with the motion options and waits; Ctrl-C holds. Returns the exit code."""
    if not 0 < o.speed <= 1:
        raise LrmError(f"--speed {o.speed:g}: should be more than 0, at most 1")
    with rover.control(lease_holder(), o.take):
        try:
            seconds = rover.move(*waypoints, pace="each" if o.each else "together", speed=o.speed, payload_kg=payload)
        except KeyboardInterrupt:
            rover.hold()
            print("held", file=sys.stderr)
            return 1
    unchecked = f"; not checked for collisions: {rover.unchecked}" if rover.unchecked else ""
    print(f"there, after {seconds:.1f} s{unchecked}")
    return 0


def hold(o: argparse.Namespace) -> int:
    """`lrm hold`: stops the motion, pulses on."""
    with open_rover(o) as rover:
        rover.hold()
    print("holding")
    return 0


def relax(o: argparse.Namespace) -> int:
    """`lrm relax`: switches servos off."""
    with open_rover(o) as rover, rover.control(lease_holder(), o.take):
        rover.relax(o.servo or None)
    print("relaxed")
    return 0


def disarm(o: argparse.Namespace) -> int:
    """`lrm disarm`: switches all servos off."""
    with open_rover(o) as rover, rover.control(lease_holder(), o.take):
        rover.disarm()
    print("disarmed")
    return 0


def reset(o: argparse.Namespace) -> int:
    """`lrm reset`: leaves fault or estop."""
    with open_rover(o) as rover, rover.control(lease_holder(), o.take):
        rover.reset_fault()
        print(rover.mode().mode)
    return 0


def estop(o: argparse.Namespace) -> int:
    """`lrm estop`: emergency stop."""
    with open_rover(o) as rover:
        rover.estop(o.why or f"lrm estop ({getpass.getuser()})")
    print("stopped: the pulses are off")
    return 0


def level1(o: argparse.Namespace) -> int:
    """`lrm level1`: servo calibration with a protractor."""
    from lrmd.cli.servo_calibration import calibrate_servo

    with open_rover(o) as rover, rover.control(lease_holder(), o.take):
        calibrate_servo(rover, o.servo, o.arm, o.output, parse_angles(o.angles))
    return 0
