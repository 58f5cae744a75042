"""Laws of every door to a motor, each over a random sequence of what may happen there.

(a) Nothing moves that was not asked for after the last stop. (b) Torque on moves no joint by more than a degree. (d) A
confirmed stop is final within the door's bound, also of what was on the way. (e) Whoever loses contact stops within the
door's bound. (f) An error while the arm is switched on names the joints that have torque, or none has. Law (c), that a
small change of a wish is a small change of the command, is that of the doors that correct a wish.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from lrm_math.errors import LrmError
from tests.doors.door import DoorKind, MotionDoor

WATCHED_S, GLANCE_S = 3.0, 0.05
"""s that a door is watched after what has to stop it, and s between two looks."""
MOST_SWAY = math.radians(1.0)
"""rad that a joint may move when it gets torque."""
SAME = 1e-9
"""rad."""


def nothing_moves_after_a_stop(kind: DoorKind, seed: int) -> float:
    """Laws (a) and (d): seconds from the confirmed stop to the last change of a command."""
    return _time_to_stand(kind, seed, lambda door: door.stop(), kind.stop_s)


def nothing_moves_after_contact_is_lost(kind: DoorKind, seed: int) -> float:
    """Law (e): seconds from the loss to the last change of a command."""
    return _time_to_stand(kind, seed, lambda door: door.lose_contact(), kind.contact_s)


def torque_on_moves_nothing(kind: DoorKind, seed: int) -> float:
    """Laws (b) and (f): the largest turn of a joint (rad), whether the door switches on or refuses."""
    rng = random.Random(seed)
    with kind.open(seed) as door:
        before, error = door.standing(), ""
        for _ in range(rng.randrange(3)):
            door.disturb()
        try:
            door.torque_on()
        except LrmError as refused:
            error = str(refused)
        powered = door.powered()
        if error:
            assert "\n" not in error, error
            unnamed = [joint for joint in powered if joint not in error]
            assert not unnamed, f"{kind.name}: {unnamed} have torque, and the error does not say so: {error}"
        door.pass_time(WATCHED_S)
        turned = float(np.max(np.abs(np.subtract(door.standing(), before))))
        assert turned <= MOST_SWAY, f"{kind.name}: torque on turned a joint by {math.degrees(turned):.1f} deg"
        return turned


def _time_to_stand(kind: DoorKind, seed: int, end: Callable[[MotionDoor], None], bound: float) -> float:
    rng = random.Random(seed)
    with kind.open(seed) as door:
        _tried(door.torque_on)
        for _ in range(rng.randint(1, 6)):
            _anything(kind, door, rng)
        end(door)
        last, seen = 0.0, door.commanded()
        for look in range(1, 1 + round(WATCHED_S / GLANCE_S)):
            door.pass_time(GLANCE_S)
            now = door.commanded()
            if np.max(np.abs(np.subtract(now, seen))) > SAME:
                last, seen = look * GLANCE_S, now
        assert last <= bound + GLANCE_S, f"{kind.name}: commands changed for {last:.2f} s; the bound is {bound} s"
        return last


def _anything(kind: DoorKind, door: MotionDoor, rng: random.Random) -> None:
    """One of what may happen before: mostly wishes, some of them overtaken at once by what comes next."""
    what = rng.choice(["ask", "ask", "ask", "ask and wait", "disturb", "stop"])
    if what.startswith("ask"):
        wish = [rng.uniform(-kind.reach, kind.reach) for _ in door.joints]
        _tried(lambda: door.ask(wish))
    elif what == "disturb":
        door.disturb()
    else:
        _tried(door.stop)
    if what != "ask":
        door.pass_time(rng.uniform(0.0, 0.5))


def _tried(request: Callable[[], None]) -> None:
    """A request that the door may refuse."""
    with suppress(LrmError):
        request()
