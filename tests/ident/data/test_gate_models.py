"""The gate of models and robots: each rule holds wherever a model is read, and wherever an arm is driven by its angles.

LeRobot's plug-in is among both. Its files (the model, the arm) need none of LeRobot; its classes stand over stand-ins
where LeRobot is not installed, and a follower with simulated servos is what they wrap.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.main import get_command

from lrm_ident.cli.app import app as ident
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from lrm_math.model.model_file import load_model
from tests.doors.lerobot_classes import calibrated_robot_class, plug_in
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
    "schema": (lambda _: MODEL.replace("lrm/model/1", "lrm/arm/1"), "lrm/model/1"),
    "kind of file": (lambda _: b"MATLAB 5.0 MAT-file" + bytes(99), "model.toml"),
    **{f"{rule} of the arm": (with_arm(rule), f'accepted = ["{rule}"]') for rule in ARM_RULES},
}


def by_command(*words: object) -> Callable[[Path], str]:
    def door(model: Path) -> str:
        folder = model.parent
        data = put(folder / "data.csv", text(table(40)))
        files = {"MODEL": model, "DATA": data, "OUT": folder / "out.toml", "CSV": folder / "out.csv"}
        return said_by(*(files.get(str(word), word) for word in words))

    return door


def follower(names: tuple[str, ...] = NAMES) -> SimulatedFollower:
    from examples.so101.feetech_servo import FeetechServo

    return SimulatedFollower(names, [FeetechServo(number) for number in range(1, 6)])


def robot_of(model: Path, robot: Any = None) -> Any:
    config = SimpleNamespace(model=str(model), payload_g=0.0, keep="base,tool", accept_settings=False)
    return calibrated_robot_class()(config, robot or follower())


def pair_of(model: Path) -> Any:
    config = SimpleNamespace(
        left_model=str(model), right_model=str(model), left_payload_g=0.0, right_payload_g=0.0, base="each",
        keep="base,tool", accept_settings=False,
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
    "report": by_command("report", "MODEL", "DATA", "-o", "OUT"),
    "show": by_command("show", "MODEL"),
    "transfer": by_command("transfer", "MODEL", "DATA", "--to", "two-joint", "-o", "OUT"),
    "undo": by_command("undo", "MODEL", "-o", "OUT"),
    "load_model": lambda model: refused(lambda: load_model(model)),
    "LeRobot robot": lambda model: refused(lambda: robot_of(model)),
    "LeRobot pair": lambda model: refused(lambda: pair_of(model)),
    "LeRobot processor": lambda model: refused(lambda: plug_in("processor").CalibratedAction(str(model))),
}


@pytest.mark.parametrize("rule", MODEL_RULES)
@pytest.mark.parametrize("door", MODEL_DOORS)
def test_every_rule_of_models_holds_at_every_door(rule: str, door: str, tmp_path: Path) -> None:
    spoil, said = MODEL_RULES[rule]
    words = MODEL_DOORS[door](put(tmp_path / "model.toml", spoil(tmp_path)))
    assert said in words
    assert "Traceback" not in words
    assert not (tmp_path / "out.toml").exists()


def test_no_door_of_models_is_forgotten() -> None:
    """`motion` has models of its own schema."""
    every = {name for name, takes in taking(get_command(ident)) if takes == "MODEL" and not name.startswith("motion")}
    assert every <= {*MODEL_DOORS}
