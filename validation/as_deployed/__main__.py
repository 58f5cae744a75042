"""`python -m validation.as_deployed`: the error of the deployed model at fresh poses before and after `auto`.

Every case is a simulated world that goes on after the measurement (`recording`). Figures are RMS over 200 fresh poses,
without noise, in multiples of a measurement's noise (0.52 mm, all axes). *Before*: the plain fit; *after*: what `auto`
ends with; both as deployed: without what no rover can know. *Ratio*: after over before. What the tool states, held out
and with noise: *shown*, in the session, and *stated*, as deployed; stated is off where it differs from the error at
fresh poses with noise. Names: `?` a candidate cause, `~` an empirical term, `+` others in its class.

Parts: `catalogue` (the catalogues of hidden effects, ten pairs of effects of session or tracker, ten trackers and
bases; 300 poses, then 80), `lean` (gravity tilted by 0 to 8 deg, 20 seeds), `beyond` (half of joint 2, 3 or 4
measured, fresh poses in the other half), `loop` (measured, deployed and sent to goals, 20 seeds: distance from them
beside that with all causes known), `real` (the real arm in nested folds, with --real; a quarter of an hour each).
A case that is in the file of results is not run again.
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

from lrm_math.errors import FileError
from validation.as_deployed.examine import examine
from validation.as_deployed.real_arm import MEASUREMENTS
from validation.as_deployed.results import line_of, report, results_file
from validation.as_deployed.worlds import COUNTS, PARTS, cases_of
from validation.options import asked
from validation.runner import run_cases


def main() -> int:
    """Reads the options, runs what is not there yet, prints the tables. Exit code 2 if a file is another one."""
    options = asked(
        __doc__,
        part=([*PARTS], "parts (default: all)", PARTS),
        real=(None, f"folder of the real arm's {MEASUREMENTS}; without it that part is skipped"),
        poses=([*COUNTS], "numbers of poses of the catalogue"),
        seeds=([int], "seeds (default: those of each part)"),
        only=([str], "only cases whose key contains one of these"),
        jobs=(1, "processes side by side"),
        out=(Path("out/as-deployed.json"), "file of results"),
    )
    there = options.real is not None and (options.real / MEASUREMENTS).exists()
    parts = [part for part in options.part if part != "real" or there]
    every = {one.key: one for part in parts for one in cases_of(part, options.seeds, options.poses)}
    keys = [key for key in every if not options.only or any(word in key for word in options.only)]
    of_case = partial(examine, real=options.real)
    try:
        file = results_file(options.out)
        found = run_cases({key: every[key] for key in keys}, of_case, line_of, options.jobs, file=file)
    except FileError as problem:
        print(problem, file=sys.stderr)
        return 2
    print(report(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
