"""Text of a model file as it goes to the daemon of another computer: without its history, and its arm by name, since
paths differ there."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

from lrm_math.errors import FileError
from lrm_math.toml_file import parse_toml

ARM = re.compile(r"^arm[ \t]*=.*$", re.MULTILINE)
HEADER = re.compile(r"^\[\[?[ \t]*[A-Za-z_]", re.MULTILINE)
"""Begin of a table of a model file, none of whose names needs quotes; not of a line of numbers in an array."""
HISTORY = re.compile(r"\[\[?[ \t]*history[ \t]*[\].]")


def text_to_deploy(path: Path) -> str:
    """The text of a model file without its history; an arm that it names by the path of a file by the name in that.

    Raises `FileError`: a file that cannot be read or is no TOML, or its arm file is none.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(path, "", f"cannot be read ({error})") from None
    tables = parse_toml(path)
    text, arm = _without_history(text, tables), tables.get("arm")
    if not isinstance(arm, str) or Path(arm).suffix != ".toml":
        return text
    from lrm_math.model.model_file import arm_of  # takes a while, and most models are of a shipped arm

    named = f"arm = {json.dumps(arm_of(path, arm).name, ensure_ascii=False)}"
    return ARM.sub(lambda _: named, text, count=1)


def _without_history(text: str, tables: Mapping[str, object]) -> str:
    """The text without the tables `[[history]]` and those below them; as it is where that cannot be cut out of it."""
    if not tables.get("history"):
        return text
    starts = [0, *(found.start() for found in HEADER.finditer(text)), len(text)]
    kept = "".join(text[a:b] for a, b in pairwise(starts) if not HISTORY.match(text, a))
    expected = {name: table for name, table in tables.items() if name != "history"}
    with suppress(tomllib.TOMLDecodeError):
        if tomllib.loads(kept) == expected:
            return kept
    return text
