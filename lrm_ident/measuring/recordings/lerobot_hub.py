"""Where a LeRobot dataset lies that is named as LeRobot names it, USER/DATASET: its own cache, or the Hub."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from lrm_math.errors import LrmError

NEEDED = ("meta/*", "data/*")
VIDEOS = "videos/*"
INSTALL = "or, for one on the Hub: pip install huggingface_hub"


def lerobot_home() -> Path:
    """LeRobot's folder of datasets: HF_LEROBOT_HOME, or `lerobot` in that of Hugging Face."""
    cache = os.environ.get("XDG_CACHE_HOME", "~/.cache")
    hub = os.environ.get("HF_HOME", str(Path(cache, "huggingface")))
    return Path(os.environ.get("HF_LEROBOT_HOME", str(Path(hub, "lerobot")))).expanduser()


def dataset_folder(named: Path, videos: bool = False) -> Path:
    """The folder of a dataset: a path, or USER/DATASET, looked for in LeRobot's cache and then on the Hub.

    Args:
        videos: whether its videos are needed, too.

    Raises `LrmError`: it is neither in the cache nor on the Hub, or cannot be fetched.
    """
    if named.exists() or named.is_absolute() or len(named.parts) != 2 or named.parts[0].startswith((".", "~")):
        return named
    home, name = lerobot_home(), "/".join(named.parts)
    if (home / named / "meta" / "info.json").is_file():
        return home / named
    fetched = home / "hub" / f"datasets--{name.replace('/', '--')}" / "snapshots"
    needed = "videos" if videos else "data"
    whole = [path for path in fetched.glob("*") if (path / "meta/info.json").is_file() and (path / needed).is_dir()]
    if whole:
        return max(whole, key=lambda path: path.stat().st_mtime)
    return _from_hub(name, home, (*NEEDED, VIDEOS) if videos else NEEDED)


def _from_hub(name: str, home: Path, patterns: Sequence[str]) -> Path:
    """Fetches parts of a dataset into LeRobot's own cache of the Hub. Raises `LrmError`."""
    where = f"{name}: there is no such folder, and no dataset of this name in {home}"
    try:
        from huggingface_hub import snapshot_download
    except ImportError:
        raise LrmError(f"{where}; give its folder, {INSTALL}") from None
    try:
        folder = snapshot_download(name, repo_type="dataset", cache_dir=home / "hub", allow_patterns=list(patterns))
    except Exception as error:  # whatever the Hub, its client or the network make of it
        why = (" ".join(str(error).split()) or type(error).__name__)[:200]
        raise LrmError(f"{where}; from the Hub it cannot be fetched ({why})") from None
    return Path(folder)
