"""Text of a model file as it goes to the daemon of another computer: with the last step of its history alone, for the
errors that the model left; and with its arm by name, since paths differ there."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

from lrm_math.text_file import read_utf8
from lrm_math.toml_file import parse_toml

ARM = re.compile(r"^arm[ \t]*=.*$", re.MULTILINE)
HEADER = re.compile(r"^\[\[?[ \t]*[A-Za-z_]", re.MULTILINE)
"""Begin of a table of a model file, none of whose names needs quotes; not of a line of numbers in an array."""
HISTORY = re.compile(r"\[\[?[ \t]*history[ \t]*[\].]")
STEP = re.compile(r"\[\[[ \t]*history[ \t]*\]\]")
PARAMETERS = re.compile(r"\[[ \t]*history[ \t]*\.[ \t]*parameters[ \t]*\]")


def text_to_deploy(path: Path) -> str:
    """The text of a model file without what led to it; an arm that it names by the path of a file by the name in that.

    Raises `FileError`: a file that cannot be read or is no TOML, or its arm file is none.
    """
    tables = parse_toml(path)
    text, arm = _without_history(read_utf8(path), tables), tables.get("arm")
    if not isinstance(arm, str) or Path(arm).suffix != ".toml":
        return text
    from lrm_math.arm.arm_file import arm_of  # takes a while, and most models are of a shipped arm

    named = f"arm = {json.dumps(arm_of(path, arm).name, ensure_ascii=False)}"
    return ARM.sub(lambda _: named, text, count=1)


def _without_history(text: str, tables: Mapping[str, object]) -> str:
    """The text with the last table `[[history]]` alone and its parameters, which it must have; the whole text where the
    others cannot be cut out."""
    steps = tables.get("history")
    if not isinstance(steps, list) or not steps:
        return text
    starts = [0, *(match.start() for match in HEADER.finditer(text)), len(text)]
    last = max((a for a in starts if STEP.match(text, a)), default=0)
    kept = "".join(
        text[a:b]
        for a, b in pairwise(starts)
        if a == last or not HISTORY.match(text, a) or (a > last and PARAMETERS.match(text, a))
    )
    last_step = {
        name: value for name, value in steps[-1].items() if not isinstance(value, dict) or name == "parameters"
    }
    expected = {**tables, "history": [last_step]}
    with suppress(tomllib.TOMLDecodeError):
        if tomllib.loads(kept) == expected:
            return kept
    return text
