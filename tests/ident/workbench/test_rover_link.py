"""The workbench beside a daemon: states come over zenoh, the model says where the tip is."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from typing import Any

import msgpack
import numpy as np
import pytest
import zenoh

import lrm_ident as lrm
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.workbench.tab.rover_link import RoverLink
from lrm_math.arm.arm import Arm
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of

Q = np.radians([10.0, -30.0, 40.0, 5.0, -20.0, 15.0])
PATIENCE_S = 30.0


@pytest.fixture
def daemon() -> Iterator[tuple[str, Any]]:
    """An endpoint at which a router of zenoh listens, and its session."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    config = zenoh.Config()
    settings = {"mode": "router", "listen/endpoints": [endpoint], "scouting/multicast/enabled": False}
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    yield endpoint, session
    session.close()


def test_the_tip_of_a_rover(daemon: tuple[str, Any], lab: Arm) -> None:
    endpoint, session = daemon
    model = nominal_model(lab)
    model = model.with_values(np.where([key.startswith("compliance.") for key in model.keys], 0.05, 0.0))
    link = RoverLink("rover", endpoint)
    link.start()
    names = [f"joint{i + 1}" for i in range(6)]
    joints = msgpack.packb({"names": [*names, "gripper"], "q_rad": [*Q.tolist(), 0.1]})
    mode = msgpack.packb({"mode": "armed", "why": "test", "payload_kg": 0.05})
    end, tip = time.monotonic() + PATIENCE_S, None
    while tip is None:
        assert time.monotonic() < end, link.failure
        session.put("lrm/rover/state/mode", mode)
        session.put("lrm/rover/state/joints", joints)
        time.sleep(0.05)
        if link.joints and link.mode:
            tip = link.tip(model)
    link.close()
    assert tip.bent[-1] == pytest.approx(lrm.predict(model, poses_of(Q, 0.05))[0], abs=1e-12)
    assert tip.nominal[-1] == pytest.approx(lrm.predict(nominal_model(lab), poses_of(Q))[0], abs=1e-12)
    assert "armed" in tip.words


def test_no_rover_is_said_so(lab: Arm) -> None:
    link = RoverLink("rover", "tcp/127.0.0.1:1")
    link.start()
    with pytest.raises(LrmError, match=r"rover|connection"):
        link.tip(nominal_model(lab))
