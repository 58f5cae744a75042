"""Hidden effects of motion, one table: `python -m validation.motion [--seed N] [--only WORD] [--json FILE]`."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict

import numpy as np

from validation.encoder_checkup.dataset_files import write_dataset
from validation.motion.cases import FIRST, LATER, arm_of
from validation.motion.outcome import answered
from validation.motion.world import recorded
from validation.options import asked


def main() -> None:
    """Makes the recordings of all cases at once, and answers one after the other."""
    given = asked(
        __doc__,
        seed=0,
        only=("", "first, later, or a part of a case's name"),
        json=None,
        write=(None, "only write the recording of the first chosen case, as a dataset"),
    )
    written = [("first", case) for case in FIRST] + [("later", case) for case in LATER]
    chosen = [(when, case) for when, case in written if given.only in ("", when) or given.only in case.name]
    rng = np.random.default_rng(given.seed)
    if given.write:
        arm, joint = arm_of(chosen[0][1], rng)
        write_dataset(given.write, recorded([arm], rng)[0], "v3.0")
        print(f"{chosen[0][1].name} in joint {joint + 1}, written to {given.write}")
        return
    arms = [arm_of(case, rng) for _, case in chosen]
    found = []
    for (when, case), (arm, joint), made in zip(chosen, arms, recorded([arm for arm, _ in arms], rng), strict=True):
        one = answered(case, arm, joint, made)
        found.append({"written": when, **asdict(one)})
        print(
            f"{when:6} {one.case:20} joint{one.joint} {one.verdict:7} {one.before:.3f} -> {one.after:.3f} deg "
            f"(noise {one.noise:.3f}), 95 % intervals {one.inside[0]}/{one.inside[1]}, {one.seconds:.0f} s: "
            f"{', '.join(one.named) or 'no cause identified'} | {'; '.join(one.rest) or '-'}",
            flush=True,
        )
    verdicts = Counter(str(one["verdict"]) for one in found)
    held, of = (sum(one["inside"][k] for one in found) for k in (0, 1))
    print(f"{dict(verdicts)}; 95 % intervals that hold the truth: {held} of {of}")
    if given.json:
        given.json.write_text(json.dumps({"seed": given.seed, "cases": found}, indent=1) + "\n")


if __name__ == "__main__":
    main()
