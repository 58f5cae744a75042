"""`python -m validation.hidden_effects.advice`: the advice after an ambiguous diagnosis, followed.

One effect is hidden in an arm that is measured badly: at three or five angles of each joint, without a second load.
Where the diagnosis cannot distinguish the truth from other causes, it is asked which poses would. The arm of the
independent generator is measured there too, and everything is diagnosed again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import lrm_ident as lrm
from lrm_ident.design.advice import Advice
from lrm_ident.design.expected_lead import CausePair
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, build_report
from lrm_ident.report.diagnosis.advice import advice_of
from lrm_ident.report.text.advice import advice_sentence
from lrm_math.arm.arm_file import load_arm as load_fitted_arm
from lrm_math.arrays import Array
from validation.hidden_effects.case import FIVE_LEVELS_DEG, Case
from validation.hidden_effects.cases import SINGLE
from validation.hidden_effects.data import NOISE_M, measured_poses, true_arm
from validation.hidden_effects.examine import base_model
from validation.options import Count, asked
from validation.synthetic import even_schedule, load_arm, simulate
from validation.synthetic.files import write

THREE_LEVELS_DEG = (-60.0, 10.0, 75.0)
HIDDEN = (
    *("gain1", "gain4", "shaft2", "shaft5", "cable1", "cable4", "coupled3-2", "coupled5-4", "spring1", "spring2"),
    *("play2", "play3", "play4", "load", "load-hung", "heavy5", "bracket2", "bracket4", "base-roll", "bending2"),
    "bending4",
)
POSES = 120
CAN, IF_EXACT, CANNOT = "can be told", "can be told if the formula is exact", "cannot be told"
TOLD, NOT_TOLD, LOST = "told", "not told", "the class has lost the truth"


@dataclass(frozen=True)
class Followed:
    """An ambiguous diagnosis of a case, the advice, and the class that holds the truth when it was followed."""

    case: str
    causes: tuple[str, ...]
    advice: Advice
    after: tuple[str, ...]

    @property
    def pairs(self) -> dict[str, tuple[str, str]]:
        """By each other cause of the class: what was said of telling it from the truth, and what came of it."""
        truth, *others = self.causes
        of = {one: [pair for pair in self.advice.pairs if {pair.there, pair.instead} == {truth, one}] for one in others}
        left = {one: NOT_TOLD if one in self.after else TOLD for one in others}
        return {one: (_said(pairs), left[one] if truth in self.after else LOST) for one, pairs in of.items()}


def _said(pairs: Sequence[CausePair]) -> str:
    """What was said beforehand of both orders of two causes."""
    if all(pair.distinguishable for pair in pairs):
        return CAN
    return IF_EXACT if all(pair.distinguishable_if_exact for pair in pairs) else CANNOT


def followed(case: Case, seed: int) -> Followed | None:
    """None where the diagnosis leaves nothing to distinguish, or its class does not hold the truth."""
    described = load_arm(case.arm_file)
    q, load, _ = measured_poses(case, seed, POSES, described)
    report = _diagnosed(case, seed, q, load)
    advice = advice_of(report)
    if advice is None or report.first is None or advice.plan is None:
        return None
    names = dict.fromkeys(pair.there for pair in advice.pairs)
    truths = [name for name in names if name in (case.truth or ())]
    if not truths:
        return None
    more = advice.plan.poses
    again = _diagnosed(case, seed, np.concatenate([q, more.q]), np.concatenate([load, more.payload]))
    after = () if again.first is None else (again.first.name, *again.first.equivalent)
    return Followed(case.name, (truths[0], *(name for name in names if name != truths[0])), advice, after)


def _diagnosed(case: Case, seed: int, q: Array, load: Array) -> DiagnosisReport:
    """The diagnosis of what the generator measures at angles (N, n), rad, with loads (N,), kg."""
    described = load_arm(case.arm_file)
    data = simulate(described, true_arm(case, seed, described), q, load, NOISE_M, seed, even_schedule(*q.shape))
    with TemporaryDirectory(prefix="advice-") as folder:
        table = write(Path(folder) / "measured", data, "synthetic: validation.hidden_effects.advice")[0]
        measured = lrm.load(table, str(case.arm_file))
    return build_report(diagnose(base_model(measured, load_fitted_arm(str(case.arm_file))), measured))


def main() -> None:
    """Prints each case, and the counts."""
    options = asked(
        __doc__, only=("", "only cases whose name contains one of these, by commas"), seeds=(Count(2), "arms")
    )
    counts: Counter[tuple[str, str]] = Counter()
    for name in (name for name in HIDDEN if any(word in name for word in options.only.split(","))):
        for seed in range(options.seeds):
            levels = FIVE_LEVELS_DEG if seed % 2 else THREE_LEVELS_DEG
            found = followed(replace(SINGLE[name], levels_deg=levels, loads_kg=(0.0,)), seed)
            if found is None:
                print(f"{name} {seed}: nothing to distinguish", flush=True)
                continue
            for other, (said, was) in found.pairs.items():
                counts[said, was] += 1
                print(f"{name} {seed}: {found.causes[0]} from {other}: {said}, {was}")
            print(f"  after: {', '.join(found.after) or 'none'}; {advice_sentence(found.advice)}", flush=True)
    for (said, was), count in sorted(counts.items()):
        print(f"{count:4d} pairs: {said}; afterwards {was}")


if __name__ == "__main__":
    main()
