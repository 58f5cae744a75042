"""Terms that the commands and the documentation use, in plain words: `python -m lrm_ident.report.glossary`.

`docs/glossary.md`, `lrm-ident explain WORD`, the page and the report show them.
"""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from lrm_math.errors import LrmError

HEAD = """# Glossary

The words that the commands and these pages use. `lrm-ident explain WORD` prints one entry in the terminal;
`lrm-ident explain backlash` explains a physical effect.
"""


@dataclass(frozen=True)
class Term:
    """A term, what it means, and other words that a reader may look it up by."""

    name: str
    meaning: str
    others: tuple[str, ...] = ()


TERMS = (
    Term(
        "as deployed",
        "The error of the model that goes to the arm. Effects of the measurement session and of the tracker "
        "are left out there, because the arm cannot know them.",
        ("deployed",),
    ),
    Term(
        "base compliance",
        "The base tilts under the weight of the arm. The tip then moves although no joint does.",
        ("yielding of the base",),
    ),
    Term(
        "black-box model",
        "A model that predicts the remaining error from the pose and knows no cause: a Gaussian process on "
        "the residuals. It shows how much of the error is systematic.",
        ("nameless model", "Gaussian process", "GP"),
    ),
    Term(
        "candidate cause",
        "An effect that would explain part of the error. The data do not yet show that it is the cause.",
        ("candidate", "possible cause"),
    ),
    Term(
        "compliance",
        "How far a joint or link gives way under a torque, in rad/Nm. The inverse of stiffness.",
        ("stiffness", "sag"),
    ),
    Term(
        "direction of approach",
        "The side from which a joint came to its angle. Backlash and friction make the two sides differ.",
        ("approach", "side"),
    ),
    Term(
        "effect",
        "One physical reason why the tip is not where the nominal model puts it, such as backlash, with its "
        "parameters. `backlash@joint2` is the effect backlash in joint 2.",
    ),
    Term(
        "empirical term",
        "A term that improves the prediction although its cause is not identified, such as a spline over a "
        "joint's angle.",
        ("description",),
    ),
    Term(
        "gear eccentricity",
        "A gear that runs off its centre. The joint's error goes once round with its angle.",
        ("eccentricity",),
    ),
    Term(
        "held-out error",
        "The error at poses that the fit has not seen. The data are split into ten parts, and each part is "
        "predicted by a fit to the other nine.",
        ("held out", "cross-validation"),
    ),
    Term(
        "identifiable",
        "These poses determine the parameter. A parameter that no pose moves, or that another one imitates, "
        "is not identifiable.",
        ("now identifiable", "identifiability"),
    ),
    Term(
        "identified cause",
        "An effect that the data show to be there: it predicts unseen poses better, no rival does as well, "
        "and what it leaves behind is small.",
        ("finding", "identified"),
    ),
    Term(
        "indistinguishable",
        "Two effects that make the same error at these poses. Other poses may distinguish them: `lrm-ident "
        "design --separate` chooses such poses.",
        ("class", "cannot be told from", "indistinguishable cause"),
    ),
    Term(
        "measurement noise",
        "The error that the instrument makes by itself. No model can predict better.",
        ("noise", "noise floor"),
    ),
    Term(
        "Moran's I",
        "The spatial autocorrelation of the residuals: 0 where errors of neighbouring poses have nothing in "
        "common, 1 where they are the same.",
        ("spatial autocorrelation of the residuals", "likeness of neighbours", "spatial autocorrelation"),
    ),
    Term(
        "nested cross-validation",
        "A stricter held-out error: not only the parameters but also the choice of effects is made anew, each time "
        "without the poses that are predicted. A choice that few of these searches repeat is unstable.",
        ("nested",),
    ),
    Term(
        "nominal",
        "As the arm file or the URDF states it, before any fit.",
        ("as drawn",),
    ),
    Term(
        "nonlinear joint stiffness",
        "A joint that becomes stiffer the further it bends.",
        ("nonlinear_stiffness", "uneven spring"),
    ),
    Term(
        "outlier",
        "A pose that fits much worse than the others: its measurement is wrong, or the model lacks an effect that "
        "shows there. The limit is five robust standard deviations.",
        ("outliers", "robust standard deviation"),
    ),
    Term(
        "remaining error",
        "The error that is left after the fit. The part above the measurement noise is unexplained.",
        ("unexplained error", "what is left"),
    ),
    Term(
        "residual",
        "Measured position minus predicted position of the tip.",
        ("residuals",),
    ),
    Term(
        "RMS",
        "Root mean square: the typical size of an error, in which large errors count more than in the mean.",
        ("root mean square",),
    ),
    Term(
        "servo gain error",
        "A servo that turns too far, or not far enough, by a fixed share of the command.",
        ("servo_gain", "wrong servo scale"),
    ),
    Term(
        "spline",
        "A smooth curve through a few knots. As a free-form version of an effect it shows the shape of an "
        "error whose formula is not known.",
        ("free curve", "free-form version", "free form"),
    ),
    Term(
        "standard error",
        "The uncertainty of an estimate, written behind ±. The true value lies within two standard errors in about 95 "
        "of 100 cases, if the model is right.",
        ("±",),
    ),
    Term(
        "stop",
        "A part of a recording in which the arm stands still.",
        ("rest",),
    ),
    Term(
        "structure of the residuals",
        "What the remaining error depends on: the pose, the load, the order, the time.",
        ("anatomy",),
    ),
    Term(
        "TCP",
        "Tool centre point: the point of the tool whose position counts. These pages also call it the tip.",
        ("tip", "tool centre point"),
    ),
    Term(
        "tracker distortion",
        "The instrument measures lengths or angles wrongly in a way that repeats.",
        ("measurement_frame",),
    ),
    Term(
        "turn of joint",
        "The error as the angle by which one joint alone would have to turn to make it.",
    ),
    Term(
        "untrusted input",
        "What another program sends. The daemon checks it before anything uses it.",
    ),
)
"""In the order of the alphabet."""
ON_PAGE = (
    "as deployed", "black-box model", "candidate cause", "empirical term", "held-out", "held out", "identified cause",
    "indistinguishable cause", "measurement noise", "Moran's I", "RMS", "turn of joint",
)  # fmt: skip
"""Words that page and report explain where they first stand."""
SCRIPT = Path(__file__).parent / "plots" / "interactive" / "page" / "terms.js"


def term_named(word: str) -> Term:
    """The entry of a word, whatever its capitals and hyphens. Raises `LrmError`."""
    for term in TERMS:
        if _plain(word) in {_plain(name) for name in (term.name, *term.others)}:
            return term
    near = get_close_matches(word.lower(), [name for term in TERMS for name in (term.name, *term.others)], 1)
    meant = f"did you mean '{near[0]}'? " if near else ""
    raise LrmError(f"unknown word '{word}'; {meant}lrm-ident explain lists the terms, lrm-ident effects the effects")


def glossary_page() -> str:
    """The page of the documentation."""
    entries = (f"**{term.name}**{_also(term)}\n: {term.meaning}\n" for term in TERMS)
    return "\n".join([HEAD, *entries])


def terms_script() -> str:
    """JavaScript with the meaning of each word of `ON_PAGE`."""
    meanings = {word: term_named(word).meaning for word in ON_PAGE}
    return f"const lrmTerms = {json.dumps(meanings, indent=1, ensure_ascii=False)};\n"


def _also(term: Term) -> str:
    return f" ({', '.join(term.others)})" if term.others else ""


def _plain(word: str) -> str:
    return re.sub(r"[\W_]+", "", word).lower()


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(glossary_page(), encoding="utf-8")
    SCRIPT.write_text(terms_script(), encoding="utf-8")
