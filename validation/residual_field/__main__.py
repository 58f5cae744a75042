"""`python -m validation.residual_field`: held-out figures on the real arm, and the promises of a field.

`--promises` leaves the held-out figures, which take six minutes, out; `--arms` prints those of other arms instead,
`--apart` the errors of the UR5 on 20 poses measured apart. The real measurements lie in ../shared/data (`--shared`).
"""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_math.arm.arm_file import load_arm
from validation.options import asked
from validation.residual_field.nameless_arm import measured
from validation.residual_field.nested import CASES, arms_table, held_out, hidden, tables, two_joint
from validation.residual_field.promises import (
    apart_table,
    refused_on_null_data,
    worst_on_null_data,
    worst_on_other_half,
)

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "data"
TWO_JOINT, DATA = (Path(name) / "measurements.csv" for name in ("lrm-two-joint", "lrm-lab-no-load"))
UR5 = Path("ur5")
HALVED = ("cable-over-3-and-5", "bearing3", "dahl1")
"""Hidden effects of arms that are learned on one half of the joint space."""


def main() -> None:
    """Prints everything."""
    known = asked(
        __doc__,
        "data?",
        arm="lrm-lab",
        promises=False,
        arms=False,
        apart=False,
        shared=(SHARED, "folder of the real measurements"),
        seeds=20,
    )
    console = Console(width=120)
    if known.apart:
        of, ur5 = known.shared / UR5, load_arm("ur5")
        console.print(apart_table(*(load_measurements(of / name, ur5) for name in ("grid.csv", "independent.csv"))))
        return
    data = load_measurements(known.data or known.shared / DATA, load_arm(known.arm))
    if known.arms:
        arms = [("two-joint", two_joint(known.shared / TWO_JOINT)), *((name, hidden(name)) for name in CASES)]
        console.print(arms_table(held_out(iter(arms))))
        return
    for table in () if known.promises else tables(data):
        console.print(table)
    console.print(f"null data: not added in {refused_on_null_data(known.seeds)} of {known.seeds}")
    console.print(f"null data: added all the same, at most {worst_on_null_data(known.seeds):.3f} × the error without")
    nameless = ((f"simulated {seed}", measured(seed, 3e-3), "option1") for seed in range(10))
    others = ((name, hidden(name), "identifiable") for name in HALVED)
    for name, one, parameters in (("real arm", data, "option1"), *nameless, *others):
        worst, which = worst_on_other_half(one, parameters)
        console.print(f"other half of the joint space, {name}: at most {worst:.3f} × the error without ({which})")


if __name__ == "__main__":
    main()
