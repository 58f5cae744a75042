"""Text of a model file as it goes to the daemon of another computer: its arm by name, since paths differ there."""

from __future__ import annotations

import json
import re
from pathlib import Path

from lrm_math.errors import FileError
from lrm_math.toml_file import parse_toml

ARM = re.compile(r"^arm[ \t]*=.*$", re.MULTILINE)


def text_to_deploy(path: Path) -> str:
    """The text of a model file; where it names its arm by the path of an arm file, the name in that file instead.

    Raises `FileError`: a file that cannot be read or is no TOML, or its arm file is none.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(path, "", f"cannot be read ({error})") from None
    arm = parse_toml(path).get("arm")
    if not isinstance(arm, str) or Path(arm).suffix != ".toml":
        return text
    from lrm_math.model.model_file import arm_of  # takes a while, and most models are of a shipped arm

    named = f"arm = {json.dumps(arm_of(path, arm).name, ensure_ascii=False)}"
    return ARM.sub(lambda _: named, text, count=1)
