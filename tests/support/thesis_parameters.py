"""The author's own parameters, from the reference values."""

from __future__ import annotations

import csv
from pathlib import Path

from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.model.model import Model, model_of

MM = 1e-3


def thesis_values(path: Path, column: str) -> dict[str, float]:
    """The reference's parameter file in our names, SI."""
    values = {}
    for row in csv.DictReader(path.open()):
        place, name = row["parameter"].split(".")
        if name == "k_rad_per_Nmm":
            values[f"compliance.{place}.k_rad_per_Nm"] = float(row[column]) * 1e3
        else:
            values[f"offsets.{place}.{name}"] = float(row[column]) * (MM if name.endswith("_mm") else 1.0)
    return values


def thesis_model(arm: Arm, values: dict[str, float]) -> Model:
    return model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"), values)
