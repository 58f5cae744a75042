"""Files of public repositories: from the network, or from a folder that has them."""

from __future__ import annotations

from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

TIMEOUT_S = 30.0
RAW = "https://raw.githubusercontent.com"


class NotReachable(Exception):
    """A data set that cannot be had here, and why."""


def fetched(repository: str, commit: str, path: str, mirror: Path | None) -> str:
    """Text of a file of a repository (owner/name) on GitHub, or from a folder `mirror` / repository / path.

    Raises `NotReachable`.
    """
    if mirror is not None:
        here = mirror / repository / path
        if not here.is_file():
            raise NotReachable(f"no {here}")
        return here.read_text(encoding="utf-8")
    address = f"{RAW}/{repository}/{commit}/{path}"
    try:
        with urlopen(address, timeout=TIMEOUT_S) as answer:
            return str(answer.read().decode("utf-8"))
    except (URLError, OSError) as error:
        raise NotReachable(f"{address}: {getattr(error, 'reason', error)}") from None
