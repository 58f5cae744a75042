"""The record of an arm's moves over zenoh: `rpc/fk` as `lrm-ident predict` has it for the same order of poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.study.api import predict
from lrm_math.model.model import Model
from lrm_math.model.model_file import load_model
from lrmd.client import FkRequest
from tests.support.daemon.daemon_harness import arm_when_ready
from tests.support.daemon.daemon_process import DaemonSetup, running_daemon, wait_for

FRICTION = {"hysteresis.joint2.h_rad": "0.02", "friction_curve.joint2.c_8deg_rad": "0.01"}
AWAY = [[0.1, 0.1, 0.1, 0.0, 0.0, 0.0], [0.05, 0.08, 0.12, 0.02, 0.0, 0.0], [0.07, 0.11, 0.1, 0.0, 0.01, 0.0]]


def with_friction(folder: Path) -> tuple[Path, Model]:
    """A model file with friction in joint 2, and its model."""
    path = folder / "model.toml"
    path.write_text(
        'schema = "lrm/model/1"\narm = "lrm-rover"\n'
        'effects = ["hysteresis@joint2", "friction_curve@joint2"]\n[parameters]\n'
        + "".join(f'"{key}" = {value}\n' for key, value in FRICTION.items())
    )
    return path, load_model(path)


@pytest.mark.slow
def test_rpc_fk_over_zenoh_is_what_predict_says_of_the_same_order(tmp_path: Path) -> None:
    path, model = with_friction(tmp_path)
    setup = DaemonSetup.make(tmp_path, {'# model = "/etc/lrm/model.toml"': f'model = "{path}"'})
    with running_daemon(setup) as _, setup.rover() as rover:
        names = rover.info().names[:6]
        with rover.control("test"):
            arm_when_ready(rover, "given", dict.fromkeys(rover.info().names, 0.0))
            wait_for(lambda: rover.mode().mode == "armed", "armed")
            q, tips = [rover.commanded_q()], [rover.fk(FkRequest(q_rad=[rover.commanded_q()])).places[0]]
            for goal in AWAY:
                rover.move(dict(zip(names, goal, strict=True)))
                q.append(rover.commanded_q())
                tips.append(rover.fk(FkRequest(q_rad=[q[-1]])).places[0])
    assert [place.direction[1] for place in tips] == [0, 1, -1, 1]
    rows = [",".join(f"{angle:.17g}" for angle in np.degrees(row)) for row in q]
    order = tmp_path / "order.csv"
    order.write_text("\n".join([",".join(f"q{j}_deg" for j in range(1, 7)), *rows]) + "\n")
    told = predict(model, load_poses(order, model.arm))
    np.testing.assert_allclose([place.tcp_m for place in tips], told, rtol=0.0, atol=1e-9)
