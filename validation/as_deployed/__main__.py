"""`python -m validation.as_deployed`: the error of the deployed model at fresh poses before and after `auto`.

Every case is a simulated world that goes on after the measurement (`recording`). Figures are RMS over 200 fresh poses,
without noise, in multiples of a measurement's noise (0.52 mm, all axes). *Before*: the plain fit; *after*: what `auto`
ends with; both as deployed: without what no rover can know. *Ratio*: after over before. *Shown*: held-out error in the
session, with noise. Names: `?` a possible cause, `~` a description, `+` others in its class.

Parts: `catalogue` (the catalogues of hidden effects, ten pairs of effects of session or tracker, ten trackers and
bases; 300 poses, then 80), `lean` (gravity tilted by 0 to 8 deg, 20 seeds), `beyond` (half of joint 2, 3 or 4
measured, fresh poses in the other half), `absurd` (estimates that are absurd by construction).
A case that is in the file of results is not run again.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import Executor
from contextlib import nullcontext
from pathlib import Path

from lrm_ident.fitting.executors import as_finished, executor_for, in_this_process
from validation.as_deployed.outcome import Record, examined
from validation.as_deployed.results import line_of, read_cases, report, write_cases
from validation.as_deployed.worlds import COUNTS, PARTS, SimulatedCase, cases_of


def examine(key: str) -> tuple[str, Record]:
    """The record of a case. Never raises."""
    case = SimulatedCase.of(key)
    try:
        run = case.record()
    except RuntimeError as problem:  # the world itself has no equilibrium
        return key, {"hidden": case.hidden, "trouble": f"world: {problem}"}
    return key, {"hidden": case.hidden, **examined(run, floor=case.part == "lean")}


def main() -> None:
    """Reads the options, runs what is not there yet, prints the tables."""
    options = _options()
    cases = read_cases(options.out)
    asked = [one.key for part in options.part or PARTS for one in cases_of(part, options.seeds, options.poses)]
    asked = [key for key in asked if not options.only or any(word in key for word in options.only)]
    asked = asked[:: options.every]
    pool = executor_for(most=options.jobs) if options.jobs > 1 else nullcontext(in_this_process())
    with pool as executor:
        run(executor, [key for key in asked if key not in cases], cases, options.out)
    known = {key: cases[key] for key in asked if key in cases}
    print(report(known, read_cases(options.beside)))


def run(executor: Executor, keys: list[str], cases: dict[str, Record], out: Path) -> None:
    """Adds the records of cases to those that are there, and writes the file after each."""
    for number, (_, (key, record)) in enumerate(as_finished(executor, examine, keys), start=1):
        cases[key] = record
        write_cases(out, cases)
        print(f"{number}/{len(keys)} {line_of(key, record)}", file=sys.stderr, flush=True)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        "python -m validation.as_deployed", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", choices=PARTS, action="append", help="parts (default: all); may be repeated")
    parser.add_argument("--poses", type=int, nargs="+", default=COUNTS, help="numbers of poses of the catalogue")
    parser.add_argument("--seeds", type=int, nargs="+", help="seeds (default: those of each part)")
    parser.add_argument("--only", action="append", help="only cases whose key contains this; may be repeated")
    parser.add_argument("--every", type=int, default=1, help="only every so many of the cases")
    parser.add_argument("--jobs", type=int, default=1, help="processes side by side")
    parser.add_argument("--beside", type=Path, help="results of other code, shown beside these")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/as-deployed.json"), help="file of results")
    return parser.parse_args()


if __name__ == "__main__":
    main()
