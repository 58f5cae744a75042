"""`python -m validation.proofs.real_arms --data FOLDER`: real arms, our model beside plain baselines.

Public data that are not part of the project (docs/public-data.md); a data set that is not there is left out. *Held
out*: cross-validation in blocks of joint space, everything refitted in each fold; the effects are chosen once, on all
poses. *As deployed*: the same of the model that goes to the arm, without what belongs to the measurement session.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import lrm_ident as lrm
from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.study.study import Study
from lrm_math.model.equilibrium import solve_equilibrium
from validation.options import asked
from validation.proofs.result_file import FOLDER, computed, write
from validation.runner import refuse, run_cases
from validation.tables import table_row

NAME = "real-arms.json"
COLUMNS = ("arm", "model", "poses", "parameters", "error of the fit, mm RMS", "held out, mm RMS", "as deployed, mm RMS")
SETS = {
    "lrm-two-joint/measurements.csv": ("two joints, printed", "two-joint", lrm.Reading(axes="-x,-y,z")),
    "lrm-lab-no-load/measurements.csv": ("Lunar Rover Mini, printed, 6 joints", "lrm-lab", lrm.Reading()),
    "ur5/grid.csv": ("UR5, industrial, 6 joints", "ur5", lrm.Reading()),
}
MODELS: dict[str, Callable[[Measurements], Study]] = {
    "nominal": Study.of,
    "rigid errors only": lambda data: Study.of(data, "offsets").fit(),
    "rigid errors and springs (fit)": lambda data: Study.of(data).fit(),
    "with the effects that auto adds": lambda data: Study.of(data).fit().auto()[1],
}


def examine(data: Path, which: tuple[str, str]) -> tuple[object, ...]:
    """A line of the table, by the name of a data set and of a model."""
    name, model = which
    words, arm, reading = SETS[name]
    measured = lrm.load(data / name, arm=arm, reading=reading)
    return words, model, *_errors(MODELS[model](measured), fitted=model != "nominal")


def _errors(study: Study, fitted: bool) -> tuple[object, ...]:
    own = error_stats(study.data.tcp - solve_equilibrium(study.model, study.data.poses).tcp).rms
    if not fitted:
        return len(study.data), 0, _mm(own), _mm(own), _mm(own)
    held_out, deployed = study.held_out.error, study.held_out.deployed
    return (
        len(study.data),
        len(study.model.free),
        _mm(own),
        None if held_out is None else _mm(held_out.rms),
        None if deployed is None else _mm(deployed.now.rms),
    )


def _mm(metres: float) -> float:
    return round(metres * 1e3, 3)


def main() -> None:
    """Writes the result."""
    options = asked(__doc__, data=(Path(), "folder of the public data"), jobs=(1, "processes"), out=FOLDER / NAME)
    cases = {f"{name}, {model}": (name, model) for name in SETS if (options.data / name).exists() for model in MODELS}
    if not cases:
        refuse(f"none of {', '.join(SETS)} is in {options.data}; name their folder by --data")
    found = run_cases(cases, partial(examine, options.data), lambda _, line: table_row(line), options.jobs)
    write(options.out, computed(COLUMNS, [*found.values()]))


if __name__ == "__main__":
    main()
