"""The record of an arm's moves over zenoh: `rpc/fk` as `lrm-ident predict` has it, goals of a creeping arm hit."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.study.api import predict
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model
from lrmd.client import FkRequest, IkRequest, MotionInterrupted, RequestRefused
from lrmd.messages.kinematics import GoalEntry
from tests.support.daemon.daemon_harness import arm_when_ready
from tests.support.daemon.daemon_process import LONGEST_LEASE, DaemonSetup, running_daemon, wait_for

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


COMPLIANCE, CONSTANT_S = 0.08, 1.5
GOALS, WAIT_S, DEADLINE_MS = 8, 1.2, 10_000.0
SETTLED_S = 0.7
"""Until the servos stand: they follow their pulses with a lag."""
LATER = [2, 3, 6, 7]
"""Goals at which the arm has been for some time in one of two regions."""
MEMORY = '[deployed.memory."creep@joint2"]\nmean = [{mean}]\nsd = [{sd}]\noffsets = {{ {offsets} }}\n'


def reached(count: int, seed: int) -> tuple[Array, Array]:
    """Tip positions (count, 3) of random poses (m), raised, then lowered, and their loads (N·m)."""
    rng, arm = np.random.default_rng(seed), load_arm("lrm-rover")
    q = rng.uniform(-0.15, 0.15, (count, arm.dof))
    q[:, 1] += np.where(2 * np.arange(count) < count, 0.7, -0.5)
    settled = solve_equilibrium(model_of(arm, ()), poses_of(q))
    return settled.tcp, settled.joint_torque[:, 1]


def errors_mm(folder: Path, goals: Array, loads: Array, waits: Sequence[float], *, remembers: bool) -> list[float]:
    """Distances of the tip from goals (mm) after arrival, of a daemon with or without the memory in its model."""
    folder.mkdir()
    mean, sd = float(loads.mean()), float(loads.std())
    offsets = f'"offsets.joint2.theta_rad" = {COMPLIANCE * mean}'
    model = folder / "model.toml"
    model.write_text(
        'schema = "lrm/model/1"\narm = "lrm-rover"\neffects = ["creep@joint2"]\n'
        f'[parameters]\n"creep.joint2.k_rad_per_Nm" = {COMPLIANCE}\n"creep.joint2.T_s" = {CONSTANT_S}\n'
        f'[deployed]\ncarried = {{ "creep@joint2" = "mean" }}\noffsets = {{ {offsets} }}\n'
        + (MEMORY.format(mean=mean, sd=sd, offsets=offsets) if remembers else "")
    )
    own = {**LONGEST_LEASE, "step_us = 1.0": "step_us = 10.0", '# model = "/etc/lrm/model.toml"': f'model = "{model}"'}
    setup, out = DaemonSetup.make(folder, own), []
    creep = f"--creep=joint2={COMPLIANCE}:{CONSTANT_S}"
    with running_daemon(setup, creep, "--dead-band-us=0.1") as (board, _), setup.rover() as rover:
        names = rover.info().names[:6]
        with rover.control("test"):
            arm_when_ready(rover, "given", dict.fromkeys(rover.info().names, 0.0))
            wait_for(lambda: rover.mode().mode == "armed", "armed")
            for goal, wait in zip(goals, waits, strict=True):
                time.sleep(wait)
                request = IkRequest(goals=[GoalEntry(position_m=goal.tolist())], deadline_ms=DEADLINE_MS)
                [answer] = rover.ik(request).answers
                assert answer.q_rad is not None, answer.text
                rover.move(dict(zip(names, answer.q_rad, strict=True)))
                time.sleep(SETTLED_S)
                tip = board.ask("tcp")
                out.append(float(np.linalg.norm([float(str(tip[f"{x}_mm"])) for x in "xyz"] - 1e3 * goal)))
            assert not rover.fk(FkRequest(q_rad=[rover.commanded_q()])).left_out or not remembers
    return out


@pytest.mark.slow
def test_goals_are_hit_with_the_memory_and_missed_without(tmp_path: Path) -> None:
    """The model without a memory has the mean of both regions."""
    (goals, loads), waits = reached(GOALS, 1), np.random.default_rng(2).uniform(0.0, WAIT_S, GOALS)

    def errors(remembers: bool, tries: int = 3) -> list[float]:
        folder = tmp_path / f"{remembers}-{tries}"
        try:
            return errors_mm(folder, goals, loads, waits, remembers=remembers)
        except (
            MotionInterrupted,
            RequestRefused,
        ) as error:  # floods of other tests may keep the client from renewing its lease
            if tries == 1 or not re.search("lease lost|lease has run out", str(error)):
                raise
        return errors(remembers, tries - 1)

    with ThreadPoolExecutor(2) as both:
        known, forgotten = both.map(errors, (True, False))
    assert np.sqrt(np.mean(np.square(known)[LATER])) < 0.6 * np.sqrt(np.mean(np.square(forgotten)[LATER]))
