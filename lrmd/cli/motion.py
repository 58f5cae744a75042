"""The commands of `lrm` that switch servos on and off and move them by angles."""

from __future__ import annotations

import argparse
import getpass
import math
import sys
from collections.abc import Mapping, Sequence

from lrm_math.errors import LrmError
from lrmd.cli.angles import angles_of
from lrmd.cli.parsing import holder, joints, named, rover_of
from lrmd.client.rover import RequestRefused, Rover


def arm(o: argparse.Namespace) -> int:
    """`lrm arm`."""
    with rover_of(o) as rover, rover.control(holder(), o.take):
        try:
            if o.q or o.at:
                rover.arm("given", joints(rover, o.q) if o.q else named(rover, o.at), o.servo)
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
    """`lrm move`."""
    with rover_of(o) as rover:
        targets = joints(rover, o.q) if o.q else {}
        targets |= named(rover, [(f"joint{n.removeprefix('joint')}", a) for n, a in o.joint] + o.servo)
        if not targets:
            raise LrmError("move: nothing to move; give --joint N ANGLE, --servo NAME ANGLE or --q")
        return through(o, rover, [targets], None if o.payload_g is None else o.payload_g / 1000)


def gripper(o: argparse.Namespace) -> int:
    """`lrm gripper`."""
    with rover_of(o) as rover:
        return through(o, rover, [named(rover, [("gripper", o.angle)])])


def pan_tilt(o: argparse.Namespace) -> int:
    """`lrm pan-tilt`."""
    with rover_of(o) as rover:
        return through(o, rover, [named(rover, [("pan", o.pan), ("tilt", o.tilt)])])


def through(
    o: argparse.Namespace, rover: Rover, waypoints: Sequence[Mapping[str, float]], payload: float | None = None
) -> int:
    """Moves through waypoints (rad) with the options of a motion, and waits. Returns the exit code; Ctrl-C holds."""
    if not 0 < o.speed <= 1:
        raise LrmError(f"--speed {o.speed:g}: should be more than 0, at most 1")
    with rover.control(holder(), o.take):
        try:
            seconds = rover.move(*waypoints, pace="each" if o.each else "together", speed=o.speed, payload_kg=payload)
        except KeyboardInterrupt:
            rover.hold()
            print("held", file=sys.stderr)
            return 1
    print(f"there, after {seconds:.1f} s")
    return 0


def hold(o: argparse.Namespace) -> int:
    """`lrm hold`."""
    with rover_of(o) as rover:
        rover.hold()
    print("holding")
    return 0


def relax(o: argparse.Namespace) -> int:
    """`lrm relax`."""
    with rover_of(o) as rover, rover.control(holder(), o.take):
        rover.relax(o.servo or None)
    print("relaxed")
    return 0


def disarm(o: argparse.Namespace) -> int:
    """`lrm disarm`."""
    with rover_of(o) as rover, rover.control(holder(), o.take):
        rover.disarm()
    print("disarmed")
    return 0


def reset(o: argparse.Namespace) -> int:
    """`lrm reset`."""
    with rover_of(o) as rover, rover.control(holder(), o.take):
        rover.reset_fault()
        print(rover.mode().mode)
    return 0


def estop(o: argparse.Namespace) -> int:
    """`lrm estop`."""
    with rover_of(o) as rover:
        rover.estop(o.why or f"lrm estop ({getpass.getuser()})")
    print("stopped: the pulses are off")
    return 0


def level1(o: argparse.Namespace) -> int:
    """`lrm level1`."""
    from lrmd.cli.servo_calibration import walk_through

    with rover_of(o) as rover, rover.control(holder(), o.take):
        walk_through(rover, o.servo, o.arm, o.output, angles_of(o.angles))
    return 0
