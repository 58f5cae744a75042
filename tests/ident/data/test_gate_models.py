"""The gate of models and robots: each rule holds wherever a model is read, and wherever an arm is driven by its angles.

LeRobot's plug-in is among both. Its files (the model, the arm) need none of LeRobot; its classes stand over stand-ins
where LeRobot is not installed, and a follower with simulated servos is what they wrap.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.main import get_command

from lrm_ident.cli.app import app as ident
from lrm_math.model.model_file import load_model
from tests.doors.lerobot_classes import calibrated_robot_class, plug_in, robot_config
from tests.doors.registry import door_kinds
from tests.doors.servos_door import MODEL, NAMES
from tests.doors.simulated_follower import SimulatedFollower, SimulatedPair
from tests.ident.data.test_gate import ARM_RULES, put, refused, said_by, table, taking, text

Spoil = Callable[[Path], str | bytes]
"""What a model file holds; an arm file may be written beside it."""


def with_arm(rule: str) -> Spoil:
    """A model of an arm whose file breaks a rule of arms."""

    def spoil(folder: Path) -> str:
        put(folder / "arm.toml", ARM_RULES[rule][0])
        return 'schema = "lrm/model/1"\narm = "arm.toml"\neffects = ["offsets"]\n'

    return spoil


MODEL_RULES: dict[str, tuple[Spoil, str]] = {
    "finite": (lambda _: MODEL + '"offsets.joint1.theta_rad" = nan\n', "nan"),
    "names": (lambda _: MODEL.replace("hysteresis@joint2", "hysteresis@joint9"), "joint9"),
    "keys": (lambda _: MODEL.replace("[parameters]", "[parameter]"), "parameter"),
    "unit of angles": (lambda _: MODEL.replace("theta_rad", "theta_deg"), "offsets.joint2.theta_deg"),
    "schema": (lambda _: MODEL.replace("lrm/model/1", "lrm/prior/1"), "schema = 'lrm/prior/1'"),
    "kind of file": (lambda _: b"MATLAB 5.0 MAT-file" + bytes(99), "model.toml"),
    **{f"{rule} of the arm": (with_arm(rule), f'accepted = ["{rule}"]') for rule in ARM_RULES},
}


def by_command(*words: object) -> Callable[[Path], str]:
    def door(model: Path) -> str:
        folder = model.parent
        data = put(folder / "data.csv", text(table(40)))
        files = {
            "MODEL": model, "DATA": data, "OUT": folder / "out.toml", "CSV": folder / "out.csv",
            "HTML": folder / "out.html",
        }  # fmt: skip
        return said_by(*(files.get(str(word), word) for word in words))

    return door


STEPS = "".join(
    f'[[history]]\nstep = "{step}"\nfit_rms_mm = 1.0\neffects = []\nparameters = {{}}\n' for step in ("fit", "add")
)
READ_NEXT = {"undo": {"names", "unit of angles", *(f"{rule} of the arm" for rule in ARM_RULES)}}
"""Rules that a door leaves to who reads the model next: it restores the tables of a step, reads no effect or arm."""


def undone(model: Path) -> str:
    model.write_bytes(model.read_bytes() + STEPS.encode())
    return by_command("undo", "MODEL", "-o", "OUT")(model)


def follower(names: tuple[str, ...] = NAMES) -> SimulatedFollower:
    from examples.so101.feetech_servo import FeetechServo

    return SimulatedFollower(names, [FeetechServo(number) for number in range(1, 6)])


def robot_of(model: Path, robot: Any = None) -> Any:
    config = robot_config(model)
    return calibrated_robot_class()(config, robot or follower())


def pair_of(model: Path) -> Any:
    config = SimpleNamespace(
        left_model=str(model), right_model=str(model), left_payload_g=0.0, right_payload_g=0.0, base="each",
        keep="base,tool", accept_settings=False, left_motion="", right_motion="", lead=False,
    )  # fmt: skip
    return plug_in("calibrated_pair").CalibratedPair(config, SimulatedPair(follower(), follower()))


MODEL_DOORS: dict[str, Callable[[Path], str]] = {
    "add": by_command("add", "MODEL", "DATA", "backlash@joint2", "-o", "OUT"),
    "arm export": by_command("arm", "export", "MODEL", "-o", "OUT"),
    "auto": by_command("auto", "MODEL", "DATA", "-o", "OUT"),
    "compare": by_command("compare", "MODEL", "DATA"),
    "diagnose": by_command("diagnose", "MODEL", "DATA"),
    "predict": by_command("predict", "MODEL", "DATA", "-o", "CSV"),
    "propose": by_command("propose", "MODEL", "DATA"),
    "report": by_command("report", "MODEL", "DATA", "-o", "HTML"),
    "show": by_command("show", "MODEL"),
    "transfer": by_command("transfer", "MODEL", "DATA", "--to", "two-joint", "-o", "OUT"),
    "undo": undone,
    "load_model": lambda model: refused(lambda: load_model(model)),
    "LeRobot robot": lambda model: refused(lambda: robot_of(model)),
    "LeRobot pair": lambda model: refused(lambda: pair_of(model)),
    "LeRobot processor": lambda model: refused(lambda: plug_in("processor").CalibratedAction(str(model))),
}


@pytest.mark.long
@pytest.mark.parametrize(
    ("door", "rule"), [(d, r) for d in MODEL_DOORS for r in MODEL_RULES if r not in READ_NEXT.get(d, ())]
)
def test_every_rule_of_models_holds_at_every_door(door: str, rule: str, tmp_path: Path) -> None:
    spoil, said = MODEL_RULES[rule]
    words = MODEL_DOORS[door](put(tmp_path / "model.toml", spoil(tmp_path)))
    assert said in words
    assert "Traceback" not in words
    assert not (tmp_path / "out.toml").exists()


def test_no_door_of_models_is_forgotten() -> None:
    """`motion` has models of its own schema."""
    every = {name for name, takes in taking(get_command(ident)) if takes == "MODEL" and not name.startswith("motion")}
    assert every <= {*MODEL_DOORS}


def stands_beyond(door: Any) -> None:
    for servo in door.servos:
        servo.angle = 0.0
    door.servos[1].angle = np.radians(140.0)


def reads_no_number(door: Any) -> None:
    for robot in followers(door):
        robot.get_observation = lambda: {f"{name}.pos": np.nan for name in NAMES}


def in_percent(door: Any) -> None:
    for robot in followers(door):
        robot.bus.motors["elbow_flex"].norm_mode = "range_0_100"


def of_others(door: Any) -> None:
    """The robot has a joint less; LeRobot reads it before it is driven."""
    for robot in followers(door):
        robot.bus.motors.pop("elbow_flex")
        for features in (robot.action_features, robot.observation_features):
            features.pop("elbow_flex.pos", None)


def followers(door: Any) -> list[Any]:
    """Robots of LeRobot that a door drives."""
    if hasattr(door, "follower"):
        return [door.follower]
    return [arm.robot for arm in (door.robot.robot.left_arm, door.robot.robot.right_arm)]


ROBOT_RULES: dict[str, tuple[Callable[[Any], None], str]] = {
    "finite": (reads_no_number, "nan"),
    "inside limits": (stands_beyond, "shoulder_lift stands at 140 deg by its encoder, 40 deg beyond its limits"),
    "unit": (in_percent, "range_0_100"),
    "names": (of_others, "elbow_flex"),
}
LEROBOT = ("LeRobot robot", "LeRobot pair", "LeRobot processor", "campaign over LeRobot", "moves over LeRobot")
IN_COUNTS = ("Feetech bus", "Dynamixel bus", "moves on a Feetech bus", "moves on a Dynamixel bus")
"""Servos that are asked by their numbers and answer in whole counts: one of the rules is left."""


def driven(kind: str, spoil: Callable[[Any], None]) -> str:
    """What a door says when the arm is switched on and asked to move; nothing moves."""
    found = next(each for each in door_kinds() if each.name == kind)
    with found.open(0) as door:
        spoil(door)
        before = door.standing()
        said = refused(lambda: (door.torque_on(), door.ask([0.1] * len(door.joints))))
        door.pass_time(1.0)
        assert np.abs(np.subtract(door.standing(), before)).max() < np.radians(1.0)
        return said


@pytest.mark.parametrize(("door", "rule"), [*product(LEROBOT, ROBOT_RULES), *product(IN_COUNTS, ["inside limits"])])
def test_every_rule_of_robots_holds_wherever_one_is_driven(door: str, rule: str) -> None:
    spoil, said = ROBOT_RULES[rule]
    assert said in driven(door, spoil)


def test_no_door_of_robots_is_forgotten() -> None:
    """Doors to a daemon need none of these rules: it commands angles by its configuration, and reads no encoder."""
    beside = {kind.name for kind in door_kinds()} - {*LEROBOT, *IN_COUNTS}
    assert all(re.search("daemon|ROS|skills", name, re.IGNORECASE) for name in beside), beside
