"""A fleet run: every arm's result is a file, written whole; what is done is not done again."""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

from pydantic import ValidationError

from lrm_ident.data.atomic_write import is_something_else, write_text
from lrm_ident.data.measurement_file.conventions import metadata_of
from lrm_ident.fitting.executors import as_finished
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.fleet.identify_arm import ArmRecord, ArmTask, identify_arm
from lrm_ident.fleet.manifest import FleetMember
from lrm_math.arm.arm_file import arm_name_for, shipped_arms
from lrm_math.errors import FileError, LrmError
from lrm_math.text_file import read_content

ARMS, MODELS = "arms", "models"


def run_fleet(
    members: Sequence[FleetMember],
    folder: Path,
    executor: Executor,
    progress: OnProgress = silent,
) -> list[ArmRecord]:
    """Identifies every arm, side by side; results in the order of the arms.

    Args:
        folder: where `arms/NAME.json` and `models/NAME.toml` are written as each arm is done. Arms whose file is there
            already, made of the same data and arm file by the same version, are not computed again.

    Raises `FileError`: a result cannot be written. `LrmError`: the workers are lost. What was written stays.
    """
    for name in (ARMS, MODELS):
        _make_folder(folder / name)
    tasks, records = list[tuple[int, ArmTask]](), dict[int, ArmRecord]()
    for number, member in enumerate(members):
        try:
            task = task_of(member, folder / MODELS)
        except LrmError as error:
            records[number] = ArmRecord(name=member.name, sha256="", reason=str(error).splitlines()[0])
            continue
        stored = stored_record(folder / ARMS / f"{member.name}.json")
        if stored is not None and stored.sha256 == task.sha256:
            records[number] = stored
        else:
            tasks.append((number, task))
    before = len(records)
    progress(before, len(members))
    tick: OnProgress = lambda done, _: progress(before + done, len(members))  # noqa: E731
    for which, record in as_finished(executor, identify_arm, [task for _, task in tasks], tick):
        if record.sha256:
            _store(record, folder)
        records[tasks[which][0]] = record
    return [records[number] for number in range(len(members))]


def task_of(member: FleetMember, models: Path) -> ArmTask:
    """The work on an arm, its files read. Raises `FileError`."""
    beside = member.data.with_suffix(".toml")
    has_beside = beside.is_file() and not is_something_else(beside)
    arm = member.arm
    data = read_content(member.data)
    if not arm:
        metadata = metadata_of(member.data)
        if metadata is None or metadata.arm is None:
            raise FileError(member.data, "", "no arm given", "a column arm, or arm in the .toml file beside the data")
        arm = metadata.arm
        if arm not in shipped_arms() and (beside.parent / arm).exists():
            arm = (beside.parent / arm).as_posix()
    return ArmTask(
        name=member.name,
        stored_arm=arm_name_for(arm, models),
        arm_text=None if arm in shipped_arms() else read_content(Path(arm)).decode("utf-8", "replace"),
        data_name=member.data.name,
        data=data,
        beside=read_content(beside) if has_beside else None,
    )


def stored_record(path: Path) -> ArmRecord | None:
    """The result in a file; None if there is none that can be read."""
    try:
        return ArmRecord.model_validate_json(path.read_bytes())
    except (OSError, ValidationError):
        return None


def _store(record: ArmRecord, folder: Path) -> None:
    """The model first: an arm whose result is there has its model too."""
    if record.model:
        write_text(folder / MODELS / f"{record.name}.toml", record.model)
    write_text(folder / ARMS / f"{record.name}.json", json.dumps(record.model_dump(by_alias=True), indent=1) + "\n")


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(path, "", f"no folder can be made there ({error.strerror})") from None
