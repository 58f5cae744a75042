"""`python -m validation.as_deployed`: the error of the deployed model at fresh poses before and after `auto`.

Every case is a simulated world that goes on after the measurement (`recording`). Figures are RMS over 200 fresh poses,
without noise, in multiples of a measurement's noise (0.52 mm, all axes). *Before*: the plain fit; *after*: what `auto`
ends with; both as deployed: without what no rover can know. *Ratio*: after over before. What the tool states, held out
and with noise: *shown*, in the session, and *stated*, as deployed; stated is off where it differs from the error at
fresh poses with noise. Names: `?` a candidate cause, `~` an empirical term, `+` others in its class.

Parts: `catalogue` (the catalogues of hidden effects, ten pairs of effects of session or tracker, ten trackers and
bases; 300 poses, then 80), `lean` (gravity tilted by 0 to 8 deg, 20 seeds), `beyond` (half of joint 2, 3 or 4
measured, fresh poses in the other half), `absurd` (estimates that are absurd by construction), `board` (closed loop on
the simulated board, 20 seeds, minutes each on an idle computer: distance from goals beside that with all causes known),
`loop` (the same without board and daemon, seconds each), `real` (the real arm in nested folds, with --real; a quarter
of an hour each).
A case that is in the file of results is not run again.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from examples.demo.world import SPEED
from lrm_ident.fitting.executors import as_finished, executor_for
from lrm_math.errors import FileError
from validation.as_deployed.examine import examine
from validation.as_deployed.outcome import Record
from validation.as_deployed.real_arm import MEASUREMENTS
from validation.as_deployed.results import line_of, read_cases, report, write_cases
from validation.as_deployed.worlds import COUNTS, PARTS, keys_of


def main() -> int:
    """Reads the options, runs what is not there yet, prints the tables. Exit code 2 if a file is another one."""
    options = _options()
    try:
        cases, beside = read_cases(options.out), read_cases(options.beside)
    except FileError as problem:
        print(problem, file=sys.stderr)
        return 2
    there = options.real is not None and (options.real / MEASUREMENTS).exists()
    parts = [part for part in options.part or PARTS if part != "real" or there]
    asked = [key for part in parts for key in keys_of(part, options.seeds, options.poses)]
    asked = [key for key in asked if not options.only or any(word in key for word in options.only)]
    asked = asked[:: options.every]
    keys = [key for key in asked if key not in cases]
    for number, (key, record) in enumerate(examined(keys, options.real, options.jobs, options.speed), start=1):
        cases[key] = record
        write_cases(options.out, cases)
        print(f"{number}/{len(keys)} {line_of(key, record)}", file=sys.stderr, flush=True)
    known = {key: cases[key] for key in asked if key in cases}
    print(report(known, beside))
    return 0


def examined(keys: Sequence[str], real: Path | None, jobs: int, speed: float) -> Iterator[tuple[str, Record]]:
    """Keys with their records, as they are done; one after the other in this process, or side by side."""
    of_key = partial(examine, real=real, speed=speed)
    if jobs == 1:
        yield from map(of_key, keys)
        return
    with executor_for(most=jobs) as executor:
        yield from (found for _, found in as_finished(executor, of_key, keys))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        "python -m validation.as_deployed", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", choices=PARTS, action="append", help="parts (default: all); may be repeated")
    parser.add_argument(
        "--real", type=Path, help=f"folder of the real arm's {MEASUREMENTS}; without it that part is skipped"
    )
    parser.add_argument("--poses", type=int, nargs="+", default=COUNTS, help="numbers of poses of the catalogue")
    parser.add_argument("--seeds", type=int, nargs="+", help="seeds (default: those of each part)")
    parser.add_argument("--only", action="append", help="only cases whose key contains this; may be repeated")
    parser.add_argument("--every", type=int, default=1, help="only every so many of the cases")
    words = "speed of the simulated board's clock, for --part board; less for a busy computer (default: %(default)g)"
    parser.add_argument("--speed", type=float, default=SPEED, help=words)
    parser.add_argument("--jobs", type=int, default=1, help="processes side by side")
    parser.add_argument("--beside", type=Path, help="results of other code, shown beside these")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/as-deployed.json"), help="file of results")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
