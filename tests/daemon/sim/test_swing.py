"""The simulated arm's links swing on springs behind their servos: frequency, decay, friction."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest

from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError, UnknownName
from lrm_math.model.model import model_of
from lrmd.config import SHIPPED, load_config
from lrmd.sim.arm import SimulatedArm
from lrmd.sim.control_socket import answer_query
from lrmd.sim.launch import simulated_board
from lrmd.sim.process import springs_of
from lrmd.sim.swing import JointSpring, SwingingLinks, inertia
from tests.daemon.sim.test_simulated_arm import BoardOnBench

ARM = load_arm("lrm-rover")
TRUTH = model_of(ARM, ())
HERE = np.array([0.3, 0.9, 0.2, 0.5, 0.1, 0.0])
STIFF = 20.0


def swung(spring: JointSpring, seconds: float = 4.0) -> np.ndarray:
    """Deflections of joint 2 (rad), every ms, after its servo stopped at once from 0.3 rad/s."""
    swing = SwingingLinks(TRUTH, {"joint2": spring})
    swing.weigh(TRUTH.chain, HERE, 0.0)
    step, out = np.array([0.0, 0.0003, 0.0, 0.0, 0.0, 0.0]), []
    for k in range(3000):
        swing.follow(HERE + (k - 3000) * step, HERE + (k - 2999) * step, 0.001)
    for _ in range(round(1000 * seconds)):
        swing.follow(HERE, HERE, 0.001)
        out.append(swing.deflection[1])
    return np.array(out)


def test_frequency_and_decay_are_those_of_spring_damper_and_inertia() -> None:
    mass, damping = float(inertia(TRUTH.chain, HERE, 0.0)[1, 1]), 0.05
    z = swung(JointSpring(STIFF, damping))
    crossings = np.flatnonzero(np.diff(np.sign(z)) > 0)
    assert 1000.0 / np.diff(crossings).mean() == pytest.approx(np.sqrt(STIFF / mass) / 2.0 / np.pi, rel=0.01)
    peaks = np.array([np.abs(part).max() for part in np.split(z, 8)])
    assert np.polyfit(0.5 * np.arange(8), np.log(peaks), 1)[0] == pytest.approx(-0.5 * damping / mass, rel=0.1)
    assert peaks[0] == pytest.approx(0.3 / np.sqrt(STIFF / mass), rel=0.15)


@pytest.mark.long
def test_friction_stops_the_swing_early_and_leaves_the_link_beside_its_place() -> None:
    friction = 0.05
    free, rubbed = swung(JointSpring(STIFF, 0.02)), swung(JointSpring(STIFF, 0.02, friction))
    assert np.ptp(rubbed[-500:]) == 0.0
    assert np.ptp(free[-500:]) > 1e-3
    assert 0.0 < abs(rubbed[-1]) <= 1.5 * friction / STIFF


def test_a_tracker_sees_the_tip_swing_after_a_move_and_come_to_rest() -> None:
    """Without springs the tip stands as soon as the servos do."""
    channels = {name: channel for channel, name in enumerate(ARM.joint_names)}

    def range_mm(springs: dict[str, JointSpring]) -> list[float]:
        rig = BoardOnBench(TRUTH)
        rig.arm = rig.link.arm = SimulatedArm(TRUTH, channels, dead_band=0.0, springs=springs)
        q = [0.0, 0.5, 0.0, 0.0, 0.0, 0.0]
        rig.command([0.0] * 6)
        rig.command(q)
        rig.wait(1.0)
        seen = []
        for _ in range(2):
            z = []
            for _ in range(40):
                rig.wait(0.01)
                z.append(
                    [float(str(answer_query(rig.link, "tcp", rig.now, Random(1), 0.0)[k])) for k in ("x_mm", "z_mm")]
                )
            seen.append(float(np.ptp(np.array(z), axis=0).max()))
            rig.wait(3.0)
            assert not rig.arm.moving
        return seen

    assert range_mm({})[0] < 0.01
    swinging = range_mm({"joint2": JointSpring(STIFF, 0.2)})
    assert swinging[0] > 2.0 > 0.01 > swinging[1]


def test_springs_of_the_configuration_reach_the_simulated_board(tmp_path, monkeypatch) -> None:
    text = SHIPPED.read_text().replace('directory = "/var/lib/lrmd"', f'directory = "{tmp_path}"')
    path = tmp_path / "lrmd.toml"
    spring = "stiffness_nm_per_rad = 20.0\ndamping_nm_s_per_rad = 0.04\n"
    path.write_text(f"{text}\n[simulation.spring.joint2]\n{spring}")
    started: list[list[str]] = []

    def popen(command, **_):
        started.append(command)
        raise LrmError("enough")

    monkeypatch.setattr("lrmd.sim.launch.subprocess.Popen", popen)
    with pytest.raises(LrmError, match="enough"), simulated_board(load_config(path)):
        pass
    assert "--spring=joint2=20.0:0.04:0.0" in started[0]
    path.write_text(f"{text}\n[simulation.spring.joint9]\n{spring}")
    with pytest.raises(LrmError, match="joint9"):
        load_config(path)


def test_bad_springs_are_refused() -> None:
    assert springs_of(["joint2=20:0.1", "joint1=5:0.1:0.2"])["joint1"] == JointSpring(5.0, 0.1, 0.2)
    for text in ("joint2", "joint2=a:1", "joint2=20", "joint2=20:0.1:nan", "joint2=0:0.1"):
        with pytest.raises(LrmError, match="spring"):
            springs_of([text])
    with pytest.raises(UnknownName, match="joint9"):
        SwingingLinks(TRUTH, {"joint9": JointSpring(1.0, 0.1)})
