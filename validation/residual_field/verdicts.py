"""`python -m validation.residual_field.verdicts`: verdicts on hidden effects, with a residual field and without.

A sample of both catalogues. The field is added to the fit whether it helps or not, the model is written and read, and
then diagnosed as it is. What differs is printed: the verdict, or a name or held-out error of the ranking. Exit code 1
where anything does.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.fitting.field.fit import fit_with_field
from lrm_ident.study.model_history import as_written
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import FIELDS, EffectRef
from validation.hidden_effects.cases import CASES
from validation.hidden_effects.catalogue import UNFAMILIAR
from validation.hidden_effects.data import write_case, write_data
from validation.options import asked

EACH, POSES, SHOWN = 18, 150, 5
SAME_M = 1e-9


def sample(each: int) -> Iterator[tuple[str, Measurements]]:
    """Name and data of cases of both catalogues, spread evenly over them."""
    for name in list(CASES)[:: max(1, len(CASES) // each)][:each]:
        with tempfile.TemporaryDirectory(prefix="hidden-") as folder:
            yield name, load_measurements(write_case(CASES[name], 0, POSES, Path(folder)), load_arm("lrm-lab"))
    for name in list(UNFAMILIAR)[:: max(1, len(UNFAMILIAR) // each)][:each]:
        with tempfile.TemporaryDirectory(prefix="unfamiliar-") as folder:
            path, _ = write_data(UNFAMILIAR[name], 0, POSES, Path(folder))
            yield name, load_measurements(path, load_arm(str(UNFAMILIAR[name].arm_file)))


def difference(data: Measurements) -> tuple[str, str]:
    """The verdict without a field, and what is different with one; "" where nothing is."""
    plain = Study.of(data).fit()
    beside = replace(plain, model=as_written(fit_with_field(plain.taken.fit, data).model, plain.arm))
    before, after = (study.diagnose() for study in (plain, beside))
    if any(EffectRef.parse(one.scored.name).id in {kind.id for kind in FIELDS} for one in after.ranking):
        return before.verdict, "the field is ranked"
    return before.verdict, "" if _same(before, after) else f"{_words(before)} became {_words(after)}"


def _same(before: DiagnosisReport, after: DiagnosisReport) -> bool:
    pairs = zip(before.ranking, after.ranking, strict=False)
    alike = all(a.scored.name == b.scored.name and abs(a.held_out_rms - b.held_out_rms) < SAME_M for a, b in pairs)
    return before.verdict == after.verdict and len(before.ranking) == len(after.ranking) and alike


def _words(report: DiagnosisReport) -> str:
    return f"{report.verdict} ({', '.join(one.scored.name for one in report.ranking[:SHOWN])})"


def main() -> int:
    """Prints a line for each case."""
    options = asked(__doc__, each=(EACH, "cases of each catalogue"))
    changed = count = 0
    for name, data in sample(options.each):
        verdict, words = difference(data)
        count, changed = count + 1, changed + bool(words)
        print(f"{name}: {verdict}; {words or 'the same with a field'}", flush=True)
    print(f"{changed} of {count} differ")
    return int(changed > 0)


if __name__ == "__main__":
    sys.exit(main())
