"""Folders in which sessions keep their steps, in the user's state folder, and the session that was there last."""

from __future__ import annotations

import json
import os
import tempfile
import time
from pathlib import Path

from lrm_ident.data.atomic_write import write_text
from lrm_ident.workbench.work.tasks import OpenFiles, OpenTask
from lrm_math.model.reading import Reading

NOTE = "session.json"


def state_folder() -> Path:
    """The workbench's part of what programs of a user keep between runs (XDG Base Directory Specification)."""
    given = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(given) if given else Path.home() / ".local" / "state") / "lrm-ident" / "workbench"


def new_folder() -> Path:
    """A new folder for the steps of a session, named by the time at which it begins, readable by its owner alone."""
    root = state_folder()
    root.mkdir(parents=True, exist_ok=True)
    return Path(tempfile.mkdtemp(prefix=time.strftime("%Y-%m-%d-%H%M%S-"), dir=root))


def note_session(folder: Path, files: OpenFiles) -> None:
    """Notes in its folder which files a session has open."""
    note = {"model": str(files.model), "data": str(files.data), "reading": files.reading.said()}
    if files.effects_file is not None:
        note["effects_file"] = str(files.effects_file)
    write_text(folder / NOTE, json.dumps(note, default=lambda frame: frame.model_dump()) + "\n")


def last_session(folder: Path, data: Path | None) -> OpenFiles | None:
    """Files of the newest other session with steps beside a folder, still there; of some measurements, if given."""
    notes = [one for one in folder.parent.glob(f"*/{NOTE}") if one.parent != folder]
    for note in sorted(notes, key=lambda one: one.stat().st_mtime, reverse=True):
        found = _noted(note)
        if found is None or found.model.name == OpenTask.kept.name:
            continue
        if not (found.model.is_file() and found.data.is_file()):
            continue
        if data is None or found.data.resolve() == data.resolve() or _is_copy(found.data, data, folder.parent):
            return found
    return None


def _is_copy(kept: Path, data: Path, root: Path) -> bool:
    """Whether a file in the state folder is a copy of measurements, as they were read once."""
    return kept.name == data.name and kept.is_relative_to(root)


def _noted(note: Path) -> OpenFiles | None:
    """Files that a note names; None of one that was cut off: there is nothing to go on with."""
    try:
        known = json.loads(note.read_text(encoding="utf-8"))
        effects = known.get("effects_file")
        reading = Reading.model_validate(known["reading"])
        return OpenFiles(Path(known["model"]), Path(known["data"]), effects and Path(effects), reading)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
