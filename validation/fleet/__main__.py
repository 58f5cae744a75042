"""A fleet's prior on arms that it has not seen: 60 poses with it, against 150 and 60 without.

`python -m validation.fleet --arms 12`. Arms of one kind come from the independent generator (`simulated_fleet`). The
first part of them is the fleet: its arms are measured at 60 poses each and identified as `lrm-ident fleet` does it, and
its prior is written to a file. The rest are held out: each is identified from 60 poses with that file (`auto --prior`),
and without it from 60 and from 150 (`auto`). The error is that of the model's tip at 200 poses never measured, against
the true tip. Prints also the population's compliances against the truth, and what sending the work costs per arm.
Exit code 1 unless the median error of 60 poses with the prior is at most that of 150 without, and false names are no
more.
"""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from lrm_ident.fitting.executors import executor_for
from lrm_ident.fitting.priors import PriorFile
from lrm_ident.fleet.fleet_prior import prior_text
from lrm_ident.fleet.fleet_report import fleet_result, outlier_sentence
from lrm_ident.fleet.manifest import read_manifest
from lrm_ident.fleet.run_fleet import MODELS, run_fleet, task_of
from lrm_math.errors import LrmError
from lrm_math.toml_file import read_toml
from validation.fleet.held_out_arm import HeldOutArm, identify
from validation.fleet.simulated_fleet import ArmOfKind, simulated_fleet, write_fleet
from validation.options import Count, asked
from validation.runner import run_cases

FEW, MANY = 60, 150


def main() -> None:
    """Prints the comparison."""
    options = asked(
        __doc__,
        arms=(Count(12), "arms in all"),
        share=(2 / 3, "part of them that is the fleet"),
        seed=(1, "of the kind and its arms"),
        own=(0.03, "factor of the errors that differ from arm to arm"),
        jobs=(2, "worker processes of this machine"),
        cluster=("", "address of a Dask scheduler, or its scheduler file"),
    )
    arms = simulated_fleet(options.arms, options.seed, options.own)
    count = max(3, round(options.arms * options.share))
    sisters, others = arms[:count], arms[count:]
    with (
        executor_for(options.cluster or None, most=options.jobs) as pool,
        TemporaryDirectory(prefix="fleet-") as scratch,
    ):
        prior = _make_prior(sisters, Path(scratch), pool)
    ways = {f"{FEW} poses, with the prior": (FEW, prior), f"{FEW} poses": (FEW, None), f"{MANY} poses": (MANY, None)}
    cases = {f"{arm.name}, {name}": (arm, *way) for name, way in ways.items() for arm in others}
    each = [*run_cases(cases, examine, _line, options.jobs, options.cluster).values()]
    found = {name: each[k * len(others) : (k + 1) * len(others)] for k, name in enumerate(ways)}
    for name, results in found.items():
        tips = [one.tip_mm for one in results]
        wrong, missed = (sum(len(getattr(one, kind)) for one in results) for kind in ("false_names", "missed"))
        every = " ".join(f"{tip:.2f}" for tip in tips)
        print(f"{name}: median tip error {np.median(tips):.3f} mm ({every}); false names {wrong}, missed {missed}")
    with_prior, _, without = ([one.tip_mm for one in results] for results in found.values())
    false_with, _, false_without = (sum(len(one.false_names) for one in results) for results in found.values())
    good = np.median(with_prior) <= np.median(without) and false_with <= false_without
    print("as good as wanted" if good else "NOT as good as wanted")
    sys.exit(0 if good else 1)


def examine(case: tuple[ArmOfKind, int, PriorFile | None]) -> HeldOutArm:
    """An arm that the fleet has not seen, identified from so many poses, with a prior or without."""
    return identify(*case)


def _line(key: str, one: HeldOutArm) -> str:
    return f"{key}: {one.tip_mm:.3f} mm"


def _make_prior(sisters: Sequence[ArmOfKind], folder: Path, pool: Executor) -> PriorFile:
    """The fleet of the sisters; what it says of the population beside the truth, and the overhead, printed."""
    members = read_manifest(write_fleet(sisters, folder / "data", FEW))
    begun = time.monotonic()
    records = run_fleet(members, folder / "fleet", pool)
    for record in records:
        print(f"  {record.name} {record.seconds:.1f} s")
    wall, work = time.monotonic() - begun, sum(record.seconds for record in records)
    task = task_of(members[0], folder / "fleet" / MODELS)
    sent, back = len(pickle.dumps(task)), len(pickle.dumps(records[0]))
    begun = time.monotonic()
    result = fleet_result(members, records, folder / "fleet" / MODELS)
    print(
        f"{len(members)} arms: {work:.1f} s of work in {wall:.1f} s; sent {sent / 1e3:.1f} kB and received "
        f"{back / 1e3:.1f} kB per arm; seen together in {time.monotonic() - begun:.1f} s"
    )
    for one in result.outliers:
        print(f"  {outlier_sentence(one)}")
    if isinstance(result.known, str):
        raise LrmError(result.known)
    path = folder / "prior.toml"
    path.write_text(prior_text(result.known, "simulated fleet", "validation.fleet"), encoding="utf-8")
    file = read_toml(path, PriorFile)
    for number in range(len(sisters[0].truth.joint_compliance_rad_per_nm)):
        truth = [arm.truth.joint_compliance_rad_per_nm[number] for arm in sisters]
        key = f"compliance.joint{number + 1}.k_rad_per_Nm"
        table = file.parameters[key]
        low, high = table.mean_interval or (np.nan, np.nan)
        least, most = table.spread_interval or (np.nan, np.nan)
        print(
            f"  {key}: true mean {np.mean(truth):.4f} in [{low:.4f}, {high:.4f}], "
            f"true spread {np.std(truth, ddof=1):.4f} in [{least:.4f}, {most:.4f}]"
        )
    for name, rate in list(file.effects.items())[:4]:
        share = np.mean([name in arm.names for arm in sisters])
        print(f"  {name}: {rate.rate:.2f} {rate.interval}, in truth {share:.2f} of the sisters")
    return file


if __name__ == "__main__":
    main()
