"""Names for people who have not read the catalogue: backlash in joint 2, δd1 for `offsets.joint1.d_mm`."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from lrm_ident.data.wording import enumerate_words
from lrm_math.arm.place_names import place_words
from lrm_math.effects import EffectRef, ParameterRef, marked
from lrm_math.effects.session_errors import session_words
from lrm_math.model.step_name import StepName

WORDS: Mapping[str, Mapping[str, str]] = tomllib.loads(
    Path(__file__).with_name("effect_words.toml").read_text(encoding="utf-8")
)
"""What people read of each effect by its id: `name`, and where there is one `repair` and `sketch`."""
OF_A_SESSION = ("drift", "drift_curve", "change_point", "second_change_point", "session")
"""Effects that may move everything alike."""
GREEK = {"alpha": "α", "beta": "β", "gamma": "γ", "theta": "θ"}


def plain_name(name: str) -> str:
    """Plain name of `id@place`; of a law or an effect of one's own, its id and place in words."""
    kind, _ = EffectRef.parse(name)
    words = words_of(name, "name") or kind.replace("_", " ") + " of {place}"
    return marked(name, words.format(place=place_in_words(name)))


def with_id(name: str) -> str:
    """Plain name of `id@place`, and that."""
    return f"{plain_name(name)} ({name})"


def enumerate_effects(names: Iterable[str], most: int) -> str:
    """Plain names of the first effects (`id@place`), and how many more there are."""
    return enumerate_words(list(map(plain_name, names)), most)


def words_of(name: str, what: str) -> str:
    """One of the `WORDS` of the effect `id@place`; "" where it has none."""
    return WORDS.get(EffectRef.parse(name).id, {}).get(what, "")


def place_in_words(name: str) -> str:
    """Where the effect `id@place` acts: `joint 2`, `base and tracker`."""
    kind, place = EffectRef.parse(name)
    return (session_words if kind in OF_A_SESSION else place_words)(place or "all places")


def effects_in_words(names: Sequence[str]) -> str:
    """Effects (`id@place`) by their kind: how many places of those at several, plain names of the others."""
    places = Counter(EffectRef.parse(name).id for name in names)
    several = [f"{kind} at {count} places" for kind, count in places.items() if count > 1]
    return ", ".join([*several, *(plain_name(name) for name in names if places[EffectRef.parse(name).id] == 1)])


def step_title(step: StepName) -> str:
    """A step of a model's history in plain words: `fit`, or the plain name of the effect that was added."""
    return plain_name(step.added) if step.added else str(step)


def symbol(key: str) -> str:
    """The thesis's letters for a parameter (Conenna 2024, Table 4.3 and section 4.3), short enough for a figure.

    `offsets.joint1.d_mm` → δd1, `offsets.base.z_mm` → δz_b, `compliance.base.k_rad_per_Nm` → k0.

    The further translation of link i stands in the thesis at the joint that it leads to: `offsets.joint2.extra_z_mm` →
    δdd3. Parameters that the thesis does not have keep their key.
    """
    effect, place, name = ParameterRef.parse(key)
    bare = name.rsplit("_", 1)[0] if effect == "offsets" else name
    joint = int(place.removeprefix("joint")) if place.startswith("joint") and place[5:].isdigit() else None
    mimic = f"m{place.removeprefix('mimic')}" if place.startswith("mimic") else ""
    if effect == "compliance":
        return f"k{mimic or joint or 0}"
    if effect != "offsets":
        return key
    if joint is None:
        return f"δ{GREEK.get(bare, bare)}_{mimic or place[0]}"
    return f"δdd{joint + 1}" if bare == "extra_z" else f"δ{GREEK.get(bare, bare)}{joint}"
