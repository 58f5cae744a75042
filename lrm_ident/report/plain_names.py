"""Names for people who have not read the catalogue: `backlash@joint2` is play in joint 2, `offsets.joint1.d_mm` δd1."""

from __future__ import annotations

import re

from lrm_math.arm.place_names import place_words
from lrm_math.effects import marked, split_key, split_name
from lrm_math.effects.session_errors import session_words

PLAIN = {
    "offsets": "wrong geometry of {place}",
    "compliance": "softness of {place}",
    "servo_droop": "yielding servo of {place}",
    "base_compliance": "rocking of the base",
    "lateral_compliance": "sideways bending of {place}",
    "bending_ends": "bending at the ends of {place}",
    "nonlinear_stiffness": "uneven spring of {place}",
    "backlash": "play in {place}",
    "axial_play": "play along the axis of {place}",
    "hysteresis": "hysteresis of {place}",
    "servo_gain": "wrong servo scale of {place}",
    "common_gain": "wrong scale of all servos",
    "eccentricity": "off-centre gear of {place}",
    "quantisation": "coarse counts of the servo of {place}",
    "cable_spring": "cable that pulls {place}",
    "coupling": "coupling of {place}",
    "payload": "wrong mass of the load",
    "mass": "wrong mass of {place}",
    "gravity": "base that is not level",
    "drift": "warm-up drift of {place}",
    "change_point": "sudden displacement of {place}",
    "second_change_point": "second displacement of {place}",
    "session": "new zero of {place} in each session",
    "measurement_frame": "wrong scale of the tracker",
    "frame_curve": "distortion of the tracker (free curve)",
    "anchor": "start of the distances",
    "touched_point": "where the touched point stood, {place}",
    "touched_board": "where the board stood, {place}",
    "angle_curve": "uneven turning of {place} (free curve)",
    "coupling_curve": "coupling of {place} (free curve)",
    "cable_curve": "cable over {place} (free curve)",
    "drift_curve": "drift of {place} (free curve)",
    "torque_curve": "yielding of {place} (free curve)",
    "bearing_curve": "loose bearing of {place} (free curve)",
    "base_curve": "yielding of the base (free curve)",
    "friction_curve": "friction of {place} (free curve)",
    "residual_field": "what no name explains",
}
OF_A_SESSION = ("drift", "drift_curve", "change_point", "second_change_point", "session")
"""Effects that may move everything alike."""
GREEK = {"alpha": "α", "beta": "β", "gamma": "γ", "theta": "θ"}
SYMBOLS = {"q": "angle", "tau": "torque"}
EFFECT = r"\b[a-z]\w*@\w+(?:(?:<-|\+)\w+)*"
ALONE = r"(?<![\w.])(?:(?P<place>(?:joint|link)\d+(?:(?:<-|\+)joint\d+)?)|(?P<symbol>q|tau)(?P<joint>\d+))(?![\w.]*\w)"
CODE_NAME = re.compile(f"{EFFECT}|{ALONE}")
"""An effect at a place; a joint or link; the symbol of a covariate. No keys of parameters (`offsets.joint2.a_mm`)."""


def plain_name(name: str) -> str:
    """Plain name of `id@place`; of a law or an effect of one's own, its id and place in words."""
    kind, place = split_name(name)
    words = PLAIN.get(kind, kind.replace("_", " ") + " of {place}")
    where = session_words if kind in OF_A_SESSION else place_words
    return marked(name, words.format(place=where(place or "all places")))


def in_words(sentence: str) -> str:
    """A sentence with its names in words: `play in joint 2`, `joint 4`, `the angle of joint 4`."""
    return CODE_NAME.sub(_words_of, sentence)


def _words_of(found: re.Match[str]) -> str:
    name, place, symbol, joint = found[0], found["place"], found["symbol"], found["joint"]
    if place:
        return place_words(place)
    return f"the {SYMBOLS[symbol]} of joint {joint}" if symbol else plain_name(name)


def step_title(step: str) -> str:
    """A step of a model's history in plain words: `fit`, or the plain name of the effect that was added."""
    added = step.removeprefix("add ").split(",")[0]
    return plain_name(added) if step.startswith("add ") else step


def symbol(key: str) -> str:
    """The thesis's letters for a parameter (Conenna 2024, Table 4.3 and section 4.3), short enough for a figure.

    `offsets.joint1.d_mm` → δd1, `offsets.base.z_mm` → δz_b, `compliance.base.k_rad_per_Nm` → k0.

    The further translation of link i stands in the thesis at the joint that it leads to: `offsets.joint2.extra_z_mm` →
    δdd3. Parameters that the thesis does not have keep their key.
    """
    effect, place, name = split_key(key)
    bare = name.rsplit("_", 1)[0] if effect == "offsets" else name
    joint = int(place.removeprefix("joint")) if place.startswith("joint") and place[5:].isdigit() else None
    if effect == "compliance":
        return f"k{joint or 0}"
    if effect != "offsets":
        return key
    if joint is None:
        return f"δ{GREEK.get(bare, bare)}_{place[0]}"
    return f"δdd{joint + 1}" if bare == "extra_z" else f"δ{GREEK.get(bare, bare)}{joint}"
