"""Each kind of observation: its derivatives, and what it takes to add one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lrm_ident.data.measurement_file import known_columns, load, write
from lrm_ident.data.measurement_file.conventions import Metadata
from lrm_ident.data.measurement_file.number_table import NumberTable
from lrm_ident.data.measurement_file.pose_quantity import ABOVE_ZERO, SD, PoseQuantity, StatedQuantity
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.distances import Distances
from lrm_ident.data.observations.encoder_readings import EncoderReadings
from lrm_ident.data.observations.kinds import KINDS
from lrm_ident.data.observations.observation import Observation
from lrm_ident.data.observations.orientations import Orientations
from lrm_ident.data.observations.touched_points import TouchedPoints
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.model_fit import nominal_model
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.forward import ChainGeometry
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.derivatives import direct_jacobian, parameter_jacobian
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.sensed import Measurand, encoder_angles, tool_rotation
from tests.support.random_arms import random_arm

TABLE = -0.05  # m


@dataclass(frozen=True)
class HeightAboveTable(Measurand):
    """Height of the TCP above a level table (m)."""

    name = "height"

    def rows(self, dof: int) -> int:
        return 1

    def by_slots(self, settled: Equilibrium, geometry: ChainGeometry, tcp: Array) -> Array:
        return tcp[:, 2:]


@dataclass(frozen=True, eq=False)
class Heights(Observation):
    """Heights (N,) above a level table (m): a kind of one's own."""

    words = "heights"
    needs = "height_sd_mm"
    is_length = True
    measurand = HeightAboveTable()
    quantities = (
        PoseQuantity("height", ("height_mm",), (), ABOVE_ZERO, may_be_empty=True),
        PoseQuantity("height_sd", ("height_sd_mm",), (), ABOVE_ZERO, SD),
    )

    @classmethod
    def read(cls, table: NumberTable, beside: Metadata) -> Iterator[Self]:
        if "height" in table:
            yield cls(table["height"][:, 0], table.column("height_sd"))

    def columns(self) -> Iterator[StatedQuantity]:
        yield "height", self.values, 6
        yield "height_sd", self.sd, 6

    def residual(self, settled: Equilibrium) -> Array:
        return np.asarray(self.values - (settled.true_tcp[:, 2] - TABLE))[:, None]

    def shift(self, settled: Equilibrium) -> Array:
        return np.asarray(self.residual(settled) * [0.0, 0.0, 1.0])


NAMES = (
    "offsets", "compliance", "servo_droop", "lateral_compliance", "servo_gain@joint2", "payload",
    "measurement_frame", "anchor", "touched_board@placement1", "touched_point@placement2",
)  # fmt: skip
SEEN = {
    "touched points": lambda settled: TouchedPoints(settled.tcp),
    "orientations": lambda settled: Orientations(tool_rotation(settled)),
    "joint feedback": lambda settled: EncoderReadings(encoder_angles(settled)),
    "distances": lambda settled: Distances(np.ones(len(settled.poses)), start=(0.15, -0.45, 0.05)),
    "heights": lambda settled: Heights(settled.true_tcp[:, 2]),
}
"""What was measured at an equilibrium: of it, each kind has a residual."""


@pytest.mark.long
@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 10**6), dof=st.integers(2, 5))
def test_derivatives_are_those_of_central_differences(seed: int, dof: int) -> None:
    """Of every kind, from the same equilibria."""
    rng, arm = np.random.default_rng(seed), random_arm(seed, dof)
    model = model_of(arm, [effect for name in NAMES for effect in effects_at(arm, name)])
    sizes = rng.uniform(0.1, 0.4, len(model.keys))
    model = model.with_values([p.default or s * p.typical for p, s in zip(model.parameters, sizes, strict=True)])
    poses = replace(poses_of(rng.uniform(-1.2, 1.2, (6, dof)), 0.05), placement=np.array([1, 2, 1, 2, 1, 2]))
    settled = solve_equilibrium(model, poses, tolerance=1e-14)
    of_set_up = [key for key in model.keys if key.startswith(("anchor", "touched", "measurement_frame"))]
    derivatives: dict[str, tuple[Observation, Array]] = {}
    for kind, seen_at in SEEN.items():
        seen = seen_at(settled)
        data = Measurements.of_tcp(poses, settled.tcp).beside(seen)
        rows = data.rows_of(seen)
        J = parameter_jacobian(settled, sensed=data.sensed)[:, rows]
        direct = direct_jacobian(settled, of_set_up, data.sensed)[:, rows]
        np.testing.assert_array_equal(direct, J[:, :, [model.keys.index(key) for key in of_set_up]], kind)
        derivatives[kind] = seen, J
    for j, parameter in enumerate(model.parameters):
        h = 1e-4 * (parameter.fixed or parameter.typical)
        step = h * (np.arange(len(model.keys)) == j)
        below, above = (
            solve_equilibrium(model.with_values(values), poses, tolerance=1e-14)
            for values in (model.values - step, model.values + step)
        )
        for kind, (seen, J) in derivatives.items():
            difference = (seen.residual(below) - seen.residual(above)) / (2 * h)
            allowed = 1e-6 * np.abs(difference).max() + 3e-15 / h
            assert np.abs(J[:, :, j] - difference).max() <= allowed, (kind, model.keys[j])


def test_a_kind_of_ones_own_is_read_fitted_and_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One class and its place in the list: exact heights beside rough positions make the arm better known along z."""
    monkeypatch.setattr(load, "KINDS", (*KINDS, Heights))
    for module in (known_columns, write):
        monkeypatch.setattr(module, "KNOWN", (*known_columns.KNOWN, *Heights.quantities))
    arm, rng = load_arm("so101"), np.random.default_rng(3)
    start = nominal_model(arm)
    sizes = rng.normal(0.0, 0.2, len(start.keys))
    truth = start.with_values([abs(s) * p.typical for s, p in zip(sizes, start.parameters, strict=True)])
    limits = 0.7 * np.array([(joint.lower, joint.upper) for joint in arm.joints])
    settled = solve_equilibrium(truth, poses_of(rng.uniform(*limits.T, (80, arm.dof))))
    rough, fine = np.full(80, 2e-3), np.full(80, 1e-4)
    height = settled.tcp[:, 2] - TABLE + fine * rng.normal(size=80)
    tcp = settled.tcp + rough[:, None] * rng.normal(size=(80, 3))
    height[height <= 0.0] = np.nan
    path = tmp_path / "table.csv"
    made = Measurements.of_tcp(settled.poses, tcp, sd=rough).beside(Heights(height, fine))
    path.write_text(write.measurements_csv(made))
    data = load.load_measurements(path, arm)
    assert "positions, heights, standard deviations" in repr(data)
    assert data.measured_rows == 3 * 80 + np.count_nonzero(~np.isnan(height)) > 3 * 80 + 40

    def error(seen: Measurements) -> float:
        found = fit_identifiable(start, seen, start.keys).fit.model
        left = solve_equilibrium(found, settled.poses).tcp - settled.tcp
        return float(np.sqrt((left[:, 2] ** 2).mean()))

    assert error(data) < 0.5 * error(replace(data, observations=(data.positions,)))
