"""Hidden arms of the independent generator, each with the model that the offline tool fits to measurements of it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np

from lerobot_robot_lrm.correction import Correction
from lrm_math.arm.arm_file import shipped_arms
from lrm_math.arrays import Array
from lrm_math.effects import EffectRef
from lrm_math.errors import LrmError
from validation.lerobot_robot.fitted_model import fitted_model
from validation.synthetic import (
    ArmDescription,
    Deviations,
    FrictionLag,
    GroundTruth,
    HiddenEffect,
    OneSidedGain,
    Schedule,
    SoftPlay,
    load_arm,
    true_state,
)

GEOMETRY_SD = {"theta_rad": 0.02, "d_m": 0.001, "a_m": 0.001, "alpha_rad": 0.008}
"""Of each link: zero offsets, lengths, and twists between axes, of which 5 mrad and more are usual."""
SPRINGS_RAD_PER_NM, BASE_RAD_PER_NM = (0.02, 0.06), (0.0, 0.01)
DEG = np.pi / 180.0


@dataclass(frozen=True)
class FittedArm:
    """A hidden arm, and the correction by the model that was fitted to it."""

    description: ArmDescription
    truth: GroundTruth
    correction: Correction

    def missed_mm(self, wish: Array, commands: Array) -> float:
        """mm from the true tip after commands (N, n), rad, to where the arm as drawn has it at a wish (n,), rad."""
        drawn = true_state(self.description, GroundTruth.nominal(self.description), wish[None]).tcp_m[-1]
        schedule = Schedule(np.arange(1.0, len(commands) + 1.0), np.ones(len(commands)), commands[0])
        tip = true_state(self.description, self.truth, commands, 0.0, schedule).tcp_m[-1]
        return float(1e3 * np.linalg.norm(tip - drawn))


def fitted_arms(arm: str, models: int) -> Iterator[FittedArm]:
    """So many arms of a shipped name or a file, by seeds from 0 on; those whose fit is refused are left out."""
    file = shipped_arms().get(arm, Path(arm))
    made = (_fitted(arm, load_arm(file), seed) for seed in count())
    found = (each for each in made if each is not None)
    yield from (next(found) for _ in range(models))


def _fitted(arm: str, description: ArmDescription, seed: int) -> FittedArm | None:
    truth, names = _hidden(description, np.random.default_rng([57, seed]))
    with tempfile.TemporaryDirectory() as folder:
        try:
            model = fitted_model(arm, description, truth, names, seed, Path(folder))
            return FittedArm(description, truth, Correction.of_file(model))
        except LrmError:
            return None


def _hidden(description: ArmDescription, rng: np.random.Generator) -> tuple[GroundTruth, list[str]]:
    """Errors of every link and spring, and on random joints of gain, play and friction; what a fit calls them."""
    joints = len(description.links)
    errors = {
        f"joint{number}.{key}": float(rng.normal(scale=sd))
        for number in range(1, joints + 1)
        for key, sd in GEOMETRY_SD.items()
    }
    effects, names = list[HiddenEffect](), [*(f"offsets@joint{number}" for number in range(1, joints + 1))]
    gain, play, friction = (int(number) for number in rng.integers(1, joints + 1, size=3))
    if rng.random() < 0.7:
        effects.append(OneSidedGain(gain, int(rng.choice([-1, 1])), float(rng.normal(scale=0.02)), 6.0 * DEG))
        names.append(f"servo_gain@joint{gain}")
    if rng.random() < 0.5:
        effects.append(SoftPlay(play, float(rng.uniform(0.3, 2.0)) * DEG, 0.05))
        names.append(f"backlash@joint{play}")
    if rng.random() < 0.5:
        effects.append(FrictionLag(friction, float(rng.uniform(0.3, 2.0)) * DEG, float(rng.uniform(1.0, 10.0)) * DEG))
        names.append(str(EffectRef(str(rng.choice(["friction_curve", "hysteresis"])), f"joint{friction}")))
    truth = replace(
        GroundTruth.nominal(description),
        deviations=Deviations.named(joints, errors),
        base_compliance_rad_per_nm=float(rng.uniform(*BASE_RAD_PER_NM)),
        joint_compliance_rad_per_nm=tuple(rng.uniform(*SPRINGS_RAD_PER_NM, size=joints).tolist()),
        effects=tuple(effects),
    )
    return truth, [*names, "compliance", "base_compliance"]
