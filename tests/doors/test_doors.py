"""One law for every door: each that is registered keeps it over random sequences, and each motor's writer is in one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.conftest import ROOT
from tests.doors import ros2_door
from tests.doors.door import DoorKind
from tests.doors.elsewhere import ELSEWHERE
from tests.doors.laws import nothing_moves_after_a_stop, nothing_moves_after_contact_is_lost, torque_on_moves_nothing
from tests.doors.registry import door_kinds, motor_writers
from tests.support.sweep import seeds

pytestmark = pytest.mark.long

QUICK, SLOW = 3, 1
"""Sequences of a door, and of one with processes behind it; more in `make soak`, most in `make doors`."""


def seeds_of(kind: DoorKind) -> range:
    return seeds(SLOW, 2) if kind.slow else seeds(QUICK, 20)


@pytest.fixture(scope="module", params=door_kinds(), ids=lambda kind: kind.name)
def kind(request: pytest.FixtureRequest) -> Iterator[DoorKind]:
    """A kind of door; its processes end with it, which took a quarter of a core from all tests that came later."""
    yield request.param
    ros2_door.end()


def test_nothing_moves_that_was_not_asked_for_after_the_last_stop(kind: DoorKind) -> None:
    for seed in seeds_of(kind):
        nothing_moves_after_a_stop(kind, seed)


def test_whoever_loses_contact_stops(kind: DoorKind) -> None:
    for seed in seeds_of(kind):
        nothing_moves_after_contact_is_lost(kind, seed)


def test_torque_on_moves_nothing_and_an_error_names_what_has_torque(kind: DoorKind) -> None:
    for seed in seeds_of(kind):
        torque_on_moves_nothing(kind, seed)


def test_every_module_that_writes_to_a_motor_is_in_a_door() -> None:
    """A new way to a motor registers here (`tests/doors/NAME_door.py`), and is then held to the laws."""
    registered = {module for kind in door_kinds() for module in kind.modules}
    writers = motor_writers()
    lacking = writers - registered - ELSEWHERE.keys()
    assert not lacking, f"no door of tests/doors has {', '.join(sorted(lacking))}"
    gone = (registered | ELSEWHERE.keys()) - writers
    assert not gone, f"{', '.join(sorted(gone))}: registered, and no writer"
    assert all((ROOT / place).exists() for place in ELSEWHERE.values())
