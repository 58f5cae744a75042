"""Links that stand displaced along the next axis: their mass shows it, though no axis moves that others could not."""

from __future__ import annotations

from pathlib import Path

import pytest

from lrm_ident.data.robot_files.arm_text import template
from lrm_ident.diagnosis.auto import run_auto
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model
from tests.support.sweep import seeds
from tests.support.upright_arm import upright_measurements

pytestmark = pytest.mark.long

NOISE = 3e-4
WITHOUT = template("upright").replace("extra_z_mm = 0.0\n", "")


def fitted(folder: Path, seed: int, softness: float, text: str) -> Fit:
    model, data = upright_measurements(folder, seed, 240, NOISE, softness=softness, text=text)
    return fit_model(model, data, "identifiable", SQUARED).fit


def test_extra_z_explains_most_of_what_soft_joints_show_of_displaced_masses(tmp_path: Path) -> None:
    arms = seeds(3, 8)

    def excess(text: str) -> float:
        """Mean square over that of the noise, less one, of several arms."""
        return sum((fitted(tmp_path, seed, 3.0, text).sigma / NOISE) ** 2 - 1.0 for seed in arms)

    without = excess(WITHOUT)
    assert without > len(arms) * 0.04  # else there is nothing to explain
    assert excess(template("upright")) < 0.4 * without


@pytest.mark.slow
def test_no_cause_is_named_on_a_healthy_arm_with_soft_joints(tmp_path: Path) -> None:
    named = []
    arms = seeds(4, 30)
    for seed in arms:
        model, data = upright_measurements(tmp_path, seed, 240, NOISE, softness=2.0)
        named += [
            step.added for step in run_auto(fit_model(model, data, "identifiable", SQUARED).fit.model, data).steps[1:]
        ]
    assert len(named) <= len(arms) / 15, named  # of thirty arms five without extra z
