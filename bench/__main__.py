"""Times of our code beside the peers', as ratios measured in one run on one core."""

from __future__ import annotations

import argparse
import platform
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.ik import one_pose
from bench.peers import Pinocchio, decomposed_exchange, scipy_fit
from bench.timing import Timing, race
from lrm_ident.data.examples import EXAMPLE
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.design.detmax import exchange
from lrm_ident.design.observability import identification_jacobian
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.parameter_sets import TABLE_4_5, no_bounds, select_parameters
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.effects import effects_at
from lrm_math.kinematics.chain import chain_of, pull_back, trig
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from validation import synthetic
from validation.proofs.result_file import computed, write

POSES, FK_POSES, CHOSEN, TOLERANCE = 393, 1000, 50, 1e-6
OURS = "lrm_math"
COLUMNS = ("what", "by", "median", "best", "unit", "ratio", "goal")


@dataclass(frozen=True)
class Comparison:
    """One computation, timed for each contender: `units` per call, `goal` per unit for ours (times `scale`)."""

    name: str
    unit: str
    units: int
    scale: float
    goal: float
    contenders: dict[str, Callable[[], object]]


def synthetic_data() -> Measurements:
    """Poses, as many as were measured on the real arm, from the independent generator."""
    rig = synthetic.load_arm(shipped_arms()["lrm-lab"])
    q = synthetic.random_poses(rig, POSES, seed=1)
    tcp = synthetic.measure(rig, synthetic.GroundTruth.random(rig, 1), q, 0.0, 3e-4, 1)
    return Measurements.of_tcp(poses_of(q), tcp)


def comparisons() -> list[Comparison]:
    """Every row of the table."""
    arm, data = load_arm("lrm-lab"), synthetic_data()
    chain = chain_of(arm)
    model = model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))
    option1 = replace(model, free=select_parameters(model, "option1"))
    fitted = fit(option1, data).model
    equilibrium = solve_equilibrium(fitted, data.poses)
    q = np.random.default_rng(0).uniform(-1.7, 1.7, (FK_POSES, 6))
    columns = [np.ascontiguousarray(column) for column in q.T]
    k = np.array([fitted.value(f"compliance.joint{i}.k_rad_per_Nm") for i in range(1, 7)])

    def tcp() -> object:
        values = chain.values(columns)
        return pull_back(chain, values, trig(chain, values))

    fk: dict[str, Callable[[], object]] = {
        OURS: lambda: frames(chain, chain.values(columns), FK_POSES),
        "lrm_math, TCP alone": tcp,
    }
    bent: dict[str, Callable[[], object]] = {OURS: lambda: solve_equilibrium(fitted, data.poses, tolerance=TOLERANCE)}
    jacobian: dict[str, Callable[[], object]] = {
        OURS: lambda: parameter_jacobian(replace(equilibrium)),  # a copy: the response of the last ones asked is kept
        "differences": lambda: differences(fitted, data.poses),
    }
    pinocchio = _pinocchio()
    if pinocchio:
        fk["pinocchio"] = lambda: pinocchio.tcp(q)
        bent["pinocchio"] = lambda: pinocchio.elastic_tcp(data.poses.q, k, TOLERANCE)
        jacobian["pinocchio (its regressors only)"] = lambda: pinocchio.regressors(data.poses.q)
    fits: dict[str, Callable[[], object]] = {
        OURS: lambda: fit(option1, data, no_bounds(option1.free)),
        "scipy, our Jacobian": lambda: scipy_fit(option1, data, jacobian=True),
        "scipy, differences": lambda: scipy_fit(option1, data, jacobian=False),
    }
    example = load_measurements(EXAMPLE, arm)
    found = fit_identifiable(model, example, model.keys).fit.model
    rover, J = load_arm("lrm-rover"), identification_jacobian(solve_equilibrium(model, data.poses), TABLE_4_5)
    selection: dict[str, Callable[[], object]] = {
        OURS: lambda: exchange(J, CHOSEN, "O1"),
        "one exchange alone, decomposing": lambda: decomposed_exchange(J, CHOSEN),
    }
    whole: dict[str, Callable[[], object]] = {OURS: lambda: build_report(diagnose(found, example))}
    return [
        Comparison(f"diagnose of {len(example)} poses, whole catalogue", "s", 1, 1.0, 15.0, whole),
        Comparison(f"FK of {FK_POSES} poses, all frames", "µs/pose", FK_POSES, 1e6, 0.25, fk),
        Comparison(f"elastic FK of {POSES} poses, to 1 µm", "µs/pose", POSES, 1e6, 6.0, bent),
        Comparison(f"3×45 total Jacobian of {POSES} poses", "ms", 1, 1e3, 10.0, jacobian),
        Comparison(f"fit of 28 parameters to {POSES} poses", "ms", 1, 1e3, 100.0, fits),
        Comparison(f"exchange search, {CHOSEN} of {POSES} poses, 28 parameters", "s", 1, 1.0, 1.0, selection),
        Comparison("nominal IK of one pose, all branches in limits", "µs", 1, 1e6, 6.0, one_pose(rover, OURS)),
    ]


def differences(model: Model, poses: Poses) -> np.ndarray:
    """The total Jacobian by central differences of the equilibrium."""
    out = np.empty((len(poses), 3, len(model.keys)))
    for j, parameter in enumerate(model.parameters):
        step = 1e-4 * parameter.typical * (np.arange(len(model.keys)) == j)
        up, down = (solve_equilibrium(model.with_values(model.values + s), poses).tcp for s in (step, -step))
        out[:, :, j] = (up - down) / (2e-4 * parameter.typical)
    return out


def _pinocchio() -> Pinocchio | None:
    try:
        return Pinocchio(load_arm("lrm-lab"))
    except ImportError:
        return None


def rows(comparison: Comparison, timings: dict[str, Timing]) -> list[tuple[str, ...]]:
    """The lines of one comparison; ratios are medians over our median."""
    ours = timings[OURS].median
    out: list[tuple[str, ...]] = []
    for name, timing in timings.items():
        value = timing.median / comparison.units * comparison.scale
        goal = f"≤ {comparison.goal:g}: {'reached' if value <= comparison.goal else 'MISSED'}" if name == OURS else ""
        figures = (
            f"{value:.3g}",
            f"{timing.best / comparison.units * comparison.scale:.3g}",
            comparison.unit,
            f"{timing.median / ours:.2f}",
        )
        out.append((comparison.name if name == OURS else "", name, *figures, goal))
    return out


def main() -> None:
    parser = argparse.ArgumentParser("python -m bench", description=__doc__)
    parser.add_argument("--json", type=Path, help="write the table to this file too, for the page of the documentation")
    options = parser.parse_args()
    console = Console(width=120)
    table = Table(title="One core, medians of nine rounds in turn; ratio: its time over ours", title_justify="left")
    for name in COLUMNS:
        table.add_column(name, justify="right" if name in ("median", "best", "ratio") else "left")
    lines: list[tuple[str, ...]] = []
    for comparison in comparisons():
        with console.status(comparison.name):
            for row in rows(comparison, race(comparison.contenders)):
                table.add_row(*row)
                lines.append((comparison.name, *row[1:]))
        table.add_section()
    console.print(table)
    console.print(f"Python {platform.python_version()}, numpy {np.__version__}, {platform.machine()}")
    if options.json:
        write(options.json, computed(COLUMNS, lines))
    if _pinocchio() is None:
        console.print("pinocchio is not installed: its rows are missing (extra 'bench')")


if __name__ == "__main__":
    main()
