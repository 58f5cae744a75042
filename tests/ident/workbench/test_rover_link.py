"""The workbench beside a daemon: its client is asked for states, the model says where the tip is."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.workbench.tab import rover_link
from lrm_ident.workbench.tab.rover_link import RoverLink
from lrm_math.arm.arm import Arm
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of

Q = np.radians([10.0, -30.0, 40.0, 5.0, -20.0, 15.0])
PATIENCE_S = 30.0


class SixJoints:
    """A daemon's client; silent after `answers` answers."""

    robot = "rover"

    def __init__(self, answers: int = 1000) -> None:
        self.answers = answers

    def __enter__(self) -> SixJoints:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def joints(self) -> Any:
        self.answers -= 1
        if self.answers < 0:
            raise LrmError("no reply of the robot 'rover'")
        return SimpleNamespace(names=[*(f"joint{i + 1}" for i in range(6)), "gripper"], q_rad=[*Q.tolist(), 0.1])

    def mode(self) -> Any:
        return SimpleNamespace(mode="armed", why="test", payload_kg=0.05)


def until(link: RoverLink, model: Any, reached: Callable[[str], bool]) -> Any:
    """The position, or the words of the failure, once they are as expected."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        try:
            found = link.position(model)
        except LrmError as error:
            found = {"words": str(error)}
        if reached(words := found["words"]):
            return found
        time.sleep(0.01)
    raise AssertionError(words)


def test_the_tip_of_a_rover(lab: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rover_link, "LOOK_S", 0.01)
    model = nominal_model(lab)
    model = model.with_values(np.where([key.startswith("compliance.") for key in model.keys], 0.05, 0.0))
    rover: Any = SixJoints(5)
    link = RoverLink(rover)
    link.start()
    found = until(link, model, lambda words: "armed (test); q 10.0 -30.0 40.0 5.0 -20.0 15.0 deg, load 50 g" in words)
    assert found["bent"][-1] == pytest.approx(1e3 * lrm.predict(model, poses_of(Q, 0.05))[0], abs=0.005)
    assert found["nominal"][-1] == pytest.approx(1e3 * lrm.predict(nominal_model(lab), poses_of(Q))[0], abs=0.005)
    until(link, model, lambda words: "no reply" in words)
    rover.answers = 5
    until(link, model, lambda words: "armed" in words)
    link.close()


def test_no_rover_is_said_so(lab: Arm) -> None:
    link = RoverLink.to("rover", "tcp/127.0.0.1:1")
    link.start()
    until(link, nominal_model(lab), lambda words: "no connection to tcp/127.0.0.1:1" in words)
    link.close()
    with pytest.raises(LrmError, match="letters, digits"):
        RoverLink.to("a robot", "tcp/127.0.0.1:1")
