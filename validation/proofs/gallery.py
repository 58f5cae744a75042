"""`python -m validation.proofs.gallery`: ten arms with something hidden, and what the tool says of each, with pictures.

Every case is measured by the generator that shares no code with the model, named by `lrm-ident auto`, and opened as the
file that `lrm-ident report` writes, in a headless Chromium; the files stay in out/gallery.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

from PIL import Image

import lrm_ident as lrm
from lrm_ident.diagnosis.attribution import term_of
from lrm_ident.report.diagnosis.conclusion import conclude
from lrm_ident.report.plain_names import plain_name
from lrm_math.effects.reference import EffectRef
from tests.support.browser import PATIENCE_MS, chromium
from tests.support.commands import stdout_of
from validation.commit import ROOT
from validation.hidden_effects.cases import CASES
from validation.hidden_effects.data import ARM_FILE, write_case
from validation.hidden_effects.outcome import ALWAYS_TRUE
from validation.options import asked
from validation.proofs.result_file import FOLDER, computed, write

PICTURES, REPORTS = FOLDER.parent / "pictures" / "gallery", ROOT / "out" / "gallery"
SEED, POSES = 1, 200
HIDDEN = {
    "play2": "play in joint 2",
    "lag3": "friction of joint 3: where it stands depends on where it came from",
    "gain1": "a servo of joint 1 that turns 2 % too little on one side of zero",
    "shaft2": "an eccentric shaft of joint 2",
    "coupled3-2": "a belt that turns joint 3 when joint 2 turns",
    "bending4": "a link that bends across",
    "load": "a load that is heavier than stated",
    "warm4": "a joint that drifts while it warms up",
    "sum-q1-q4": "an error that depends on two joints together: outside the catalogue",
    "nothing": "nothing",
}
"""By case: what is hidden, in words."""
COLUMNS = (
    "hidden", "what the tool says", "fit, held out, mm RMS", "with it, held out, mm RMS", "as deployed, mm RMS",
    "report",
)  # fmt: skip
VIEW, WIDTH, COLOURS = {"width": 1100, "height": 760}, 550, 64


def lines() -> Iterator[tuple[object, ...]]:
    """A line for each case."""
    REPORTS.mkdir(parents=True, exist_ok=True)
    PICTURES.mkdir(parents=True, exist_ok=True)
    with chdir(REPORTS), chromium() as browser:  # commands on the pictures name files, no folders
        for name, hidden in HIDDEN.items():
            table = write_case(CASES[name], SEED, POSES, Path())
            run, study = lrm.Study.of(lrm.load(table, arm=ARM_FILE.stem)).fit().auto()
            study.save(model := Path(f"{name}-model.toml"))
            stdout_of("report", model, table, "-o", report := Path(f"{name}.html"))
            _picture(browser, report.resolve(), PICTURES / f"{name}.png")
            held_out, deployed = study.held_out.error, study.held_out.deployed
            line = (
                hidden,
                _said(run),
                _mm(run.steps[0].held_out_rms),
                None if held_out is None else _mm(held_out.rms),
                None if deployed is None else _mm(deployed.now.rms),
                f"{name}.png",
            )
            print(*line, sep=" | ", flush=True)
            yield line


def _said(run: Any) -> str:
    found = [
        f"{plain_name(step.added)}: {term_of(attribution.kind, step.evidence.equivalent)}"
        for step, attribution in zip(run.steps[1:], run.attributions, strict=True)
        if step.added and EffectRef.parse(step.added).id not in ALWAYS_TRUE
    ]
    return "; ".join(found) or conclude(run.report).headline


def _picture(browser: Any, report: Path, path: Path) -> None:
    """The first view of a report file."""
    page = browser.new_page(viewport=VIEW)
    page.set_default_timeout(PATIENCE_MS)
    page.goto(report.as_uri())
    page.wait_for_timeout(2500)
    shot = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    page.close()
    small = shot.resize((WIDTH, round(WIDTH * shot.height / shot.width)), Image.Resampling.LANCZOS)
    small.quantize(COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).save(path, optimize=True)


def _mm(metres: float) -> float:
    return round(metres * 1e3, 2)


def main() -> None:
    """Writes the result and the pictures."""
    write(asked(__doc__, out=FOLDER / "gallery.json").out, computed(COLUMNS, list(lines())))


if __name__ == "__main__":
    main()
