"""`python -m validation.lerobot_robot.recording`: LeRobot's own `record_loop` on simulated arms.

One arm and two, without correction, with the processor steps beside the robot, and by the calibrated robot. A scripted
leader goes to goals from both sides and stops; at each stop the true tip is read. What is recorded is a dataset of
LeRobot's, which `lrm-ident checkup` then reads. Needs LeRobot 0.5 or later with its extras feetech and dataset.
"""

from __future__ import annotations

import json
import logging
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import draccus
import lerobot
import lerobot.motors.feetech.feetech as feetech
import numpy as np
from lerobot.datasets import LeRobotDataset, aggregate_pipeline_dataset_features, create_initial_features
from lerobot.processor import RobotProcessorPipeline, make_default_processors
from lerobot.robots.utils import make_robot_from_config
from lerobot.scripts.lerobot_record import record_loop
from lerobot.teleoperators import Teleoperator
from lerobot.utils.feature_utils import combine_feature_dicts
from lerobot.utils.import_utils import register_third_party_plugins

from examples.so101.hidden_arm import ARM_FILE, hidden_truth
from examples.so101.launch import simulated_so101
from lerobot_robot_lrm import CalibratedAction, CalibratedObservation, calibrated_processors
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrmd.sim.control_socket import query_board
from tests.support.commands import run_command
from validation.lerobot_robot.closed_loop import both_sides
from validation.lerobot_robot.fitted_model import fit_hidden
from validation.lerobot_robot.simulated_follower import MOTORS, ROBOT_ID, Parsed, with_retries, write_calibration
from validation.synthetic import GroundTruth, load_arm, random_poses, true_state
from validation.tables import markdown_table, table_row

FPS, MOVE, STOP = 10, 8, 8
"""Frames a second; frames of a move and of a stop."""
GOALS, LIMIT_DEG, PATIENT_MS = 4, 50.0, 5000.0
WAYS = ("uncorrected", "processor steps", "calibrated robot")
HIDDEN = (("", "friction", 1), ("left_", "gain", 2), ("right_", "play", 3))
"""Arms: prefix of its joints, the effect that is hidden in it, seed."""
OTHER_GAINS = """
[provenance.servos.shoulder_lift]
p = 32
"""


@dataclass(frozen=True)
class RecordedArm:
    """An arm behind a bus: prefix of its joints' names, device, model file.

    wishes: (P, n), rad. drawn: (P, 3), m, tips of the arm as drawn there.
    """

    prefix: str
    link: Path
    model: Path
    wishes: Array
    drawn: Array


class ScriptedLeader(Teleoperator):
    """A leader that moves straight from wish to wish and stops at each; `tips`: (3,), m, of each arm at its stops."""

    config_class, name = SimpleNamespace, "scripted"
    is_connected = is_calibrated = True

    def __init__(self, arms: Sequence[RecordedArm], events: dict[str, bool]) -> None:
        self.arms, self.events, self.frame = arms, events, 0
        self.tips: list[list[Array]] = [[] for _ in arms]

    @property
    def action_features(self) -> dict[str, type]:
        return {f"{arm.prefix}{motor}.pos": float for arm in self.arms for motor in MOTORS}

    @property
    def feedback_features(self) -> dict[str, type]:
        return {}

    def get_action(self) -> dict[str, float]:
        row, step = divmod(self.frame, MOVE + STOP)
        self.frame += 1
        if step == MOVE + STOP - 1:
            self._look()
        last = len(self.arms[0].wishes) - 1
        if row >= last and step == MOVE + STOP - 1:
            self.events["exit_early"] = True
        share, out = min(1.0, (step + 1) / MOVE), dict[str, float]()
        for arm in self.arms:
            before, wish = arm.wishes[max(row - 1, 0)], arm.wishes[min(row, last)]
            degrees = [*np.degrees(before + share * (wish - before)), 50.0]
            out |= {f"{arm.prefix}{motor}.pos": float(x) for motor, x in zip(MOTORS, degrees, strict=True)}
        return out

    def _look(self) -> None:
        for arm, tips in zip(self.arms, self.tips, strict=True):
            while query_board(arm.link, "joints")["moving"]:
                time.sleep(0.02)
            tips.append(np.array(query_board(arm.link, "tip")["tip_m"]))

    def connect(self, calibrate: bool = True) -> None: ...
    def calibrate(self) -> None: ...
    def configure(self) -> None: ...
    def send_feedback(self, feedback: dict[str, Any]) -> None: ...
    def disconnect(self) -> None: ...


@contextmanager
def simulated_arms(folder: Path, prefixes: Sequence[str]) -> Iterator[list[RecordedArm]]:
    """Arms with hidden errors behind simulated buses, each with the model that was fitted to it."""
    arm, out = load_arm(ARM_FILE), []
    with ExitStack() as running:
        for prefix, effect, seed in (each for each in HIDDEN if each[0] in prefixes):
            (own := folder / f"arm_{prefix}").mkdir()
            model = fit_hidden(hidden_truth(arm, effect, seed), effect, seed, own)
            wishes = both_sides(random_poses(arm, GOALS, seed + 1000, LIMIT_DEG))
            drawn = true_state(arm, GroundTruth.nominal(arm), wishes).tcp_m
            link = running.enter_context(simulated_so101(own, effect, seed))
            out.append(RecordedArm(prefix, link, model, wishes, drawn))
        yield out


@contextmanager
def connected(folder: Path, arms: Sequence[RecordedArm], calibrated: bool) -> Iterator[Any]:
    """LeRobot's robot of these arms, made of a command line's words."""
    for arm in arms:
        tail = f"_{arm.prefix.strip('_')}" if arm.prefix else ""
        write_calibration(folder / f"{ROBOT_ID}{tail}.json")
    one = len(arms) == 1
    options = {"id": ROBOT_ID, "calibration_dir": str(folder)}
    options["type"] = ("so101_follower" if one else "bi_so_follower") + ("_calibrated" if calibrated else "")
    for arm in arms:
        options["port" if one else f"{arm.prefix}arm_config.port"] = str(arm.link)
        options |= {f"{arm.prefix}model": str(arm.model)} if calibrated else {}
    words = [f"--robot.{name}={value}" for name, value in options.items()]
    robot = make_robot_from_config(draccus.parse(Parsed, args=words).robot)
    robot.connect(calibrate=False)
    buses = [robot] if one else [robot.left_arm, robot.right_arm]
    for each in buses:
        with_retries(each, partial(each.bus.write_calibration, each.calibration))
    try:
        yield robot
    finally:
        for each in buses:
            with_retries(each, each.disconnect)


def pipelines(robot: Any, arms: Sequence[RecordedArm], way: str) -> tuple[Any, Any]:
    """`robot_action_processor` and `robot_observation_processor` of a way."""
    _, action, observation = make_default_processors()
    if way != "processor steps":
        return action, observation
    if len(arms) == 1:
        return calibrated_processors(robot, str(arms[0].model))
    steps = [
        [step(str(arm.model), prefix=arm.prefix) for arm in arms] for step in (CalibratedAction, CalibratedObservation)
    ]
    turns = [{"to_transition": each.to_transition, "to_output": each.to_output} for each in (action, observation)]
    before, after = (RobotProcessorPipeline(steps=own, **turn) for own, turn in zip(steps, turns, strict=True))
    return before, after


def recorded(folder: Path, arms: Sequence[RecordedArm], way: str) -> tuple[list[Array], Path]:
    """RMS tip errors: (G,), m, at the goals of each arm; and the folder of the dataset."""
    events = {"exit_early": False}
    leader, teleop = ScriptedLeader(arms, events), make_default_processors()[0]
    with connected(folder, arms, way == WAYS[2]) as robot:
        before, after = pipelines(robot, arms, way)
        features = combine_feature_dicts(
            aggregate_pipeline_dataset_features(
                pipeline=teleop, initial_features=create_initial_features(action=robot.action_features)
            ),
            aggregate_pipeline_dataset_features(
                pipeline=after, initial_features=create_initial_features(observation=robot.observation_features)
            ),
        )
        root = folder / f"{way} {len(arms)}".replace(" ", "_")
        dataset = LeRobotDataset.create("lrm/simulated", FPS, features, root, robot.name, use_videos=False)
        record_loop(
            robot=robot, events=events, fps=FPS, teleop_action_processor=teleop, robot_action_processor=before,
            robot_observation_processor=after, dataset=dataset, teleop=leader, control_time_s=3600,
            single_task="goals from both sides",
        )  # fmt: skip
        dataset.save_episode()
        dataset.finalize()
    goals = slice(1, None, 2)
    return [np.array(tips)[goals] - arm.drawn[goals] for tips, arm in zip(leader.tips, arms, strict=True)], root


def main() -> None:
    """Prints a table, what a checkup of each dataset says, and how wrong gains are refused."""
    register_third_party_plugins()
    logging.getLogger().setLevel(logging.ERROR)
    feetech.patch_setPacketTimeout = _patient
    print(f"LeRobot {lerobot.__version__}, Python {sys.version.split()[0]}")
    print(markdown_table(("arm", "way", "tip at goals: RMS (mm)", "worst (mm)", "recorded frames, by checkup"), ()))
    for prefixes in (("",), ("left_", "right_")):
        with tempfile.TemporaryDirectory(prefix="lrm-") as name, simulated_arms(Path(name), prefixes) as arms:
            for way in WAYS:
                errors, dataset = recorded(Path(name), arms, way)
                for arm, off in zip(arms, errors, strict=True):
                    far = 1e3 * np.linalg.norm(off, axis=1)
                    what = arm.prefix.strip("_") or "one"
                    rms, says = float(np.sqrt(np.mean(far**2))), _checkup(dataset, arm.prefix)
                    print(table_row((what, way, f"{rms:.2f}", f"{far.max():.2f}", says)), flush=True)
            print(f"\n{_refusal(Path(name), arms)}\n", flush=True)


def _checkup(dataset: Path, prefix: str) -> str:
    words = ["checkup", dataset, *(["--prefix", prefix] if prefix else []), "--json", dataset / "checkup.json"]
    code, _, said = run_command(*words)
    if code == 2:
        return said.strip().splitlines()[-1]
    found = json.loads((dataset / "checkup.json").read_text())
    named = ", ".join(f"{one['joint']} {one['cause']} {one['size_deg']:.1f}°" for one in found["findings"])
    return f"{found['rests']} stops: {named or 'nothing'}"


def _refusal(folder: Path, arms: Sequence[RecordedArm]) -> str:
    """How a model that was measured with other gains is refused. Raises `AssertionError`: it is not."""
    last = arms[-1].model
    last.write_text(last.read_text() + OTHER_GAINS)
    try:
        with connected(folder, arms, True):
            raise AssertionError("not refused")
    except LrmError as error:
        return f"wrong gains: {str(error).replace(str(folder), '…')}"


def _patient(port: Any, _: int) -> None:
    """LeRobot's 50 ms are too short for simulated servos on a busy machine."""
    port.packet_start_time, port.packet_timeout = port.getCurrentTime(), PATIENT_MS


if __name__ == "__main__":
    main()
