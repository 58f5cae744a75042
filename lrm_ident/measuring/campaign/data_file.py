"""The measurement file of a campaign: one whole line a pose, on the disk before the arm moves on.

A line is written in one piece and synchronised; what a crash leaves of an unfinished one is cut off on the next
opening, so that no pose is lost and none stands there twice.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import tomli_w

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurement_file.conventions import Metadata
from lrm_ident.data.measurement_file.pose_quantity import QUATERNION
from lrm_ident.data.measurement_file.write import metadata_toml
from lrm_ident.data.rigid_motion import quaternions
from lrm_ident.data.table_text.csv_file import read_table
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.tracker.dwell import RestMean
from lrm_math.arm.arm_file import GRAM, MM
from lrm_math.errors import FileError
from lrm_math.toml_file import read_toml

LEAST_SROT_DEG = 1e-3
DAY = 86_400.0
"""s; DTrack's time begins at midnight."""


@dataclass(frozen=True)
class ArmState:
    """State commanded at a pose.

    `q`: angles of the pulses that the board puts out, rounded to its counts (rad). `direction`: last move of each
    joint (1, 0, −1). `temperature`: of the hottest winding, by the daemon's thermal model (degC). `session`: of the
    servos' power, from 1.
    """

    q: tuple[float, ...]
    direction: tuple[int, ...]
    temperature: float
    session: int


@dataclass(frozen=True)
class PowerOn:
    """Power-on session of the servos.

    `name`: another whenever they were switched on anew. `ago`: how long they have had power (s). `temperature`: of the
    hottest then (degC). None where that is not known.
    """

    name: str
    ago: float | None = None
    temperature: float | None = None


class DataFile:
    """`NAME.csv` with its metadata `NAME.toml`, open for more rows. `done`: numbers of the poses it has, in order."""

    def __init__(self, path: Path, joints: int, orientation: bool = False) -> None:
        """Opens the file, and cuts off an unfinished line. Raises `FileError`: it is no file of such a campaign.

        `orientation`: its rows have the tool's orientation, too.
        """
        self.path, self._joints, self._orientation = path, joints, orientation
        self._cut_unfinished()
        self.done: list[int] = []
        self.last_session, self._last_t = 1, 0.0
        if path.exists() and path.stat().st_size:
            table = read_table(path)
            self.done = [int(row[0]) for row in table.rows]
            self._last_t = max((float(row[1]) for row in table.rows), default=0.0)
            self.last_session = max((int(row[2]) for row in table.rows), default=1)
        self.head: Metadata | None = read_toml(self.metadata, Metadata) if self.metadata.exists() else None
        if self.done and self.head is None:
            raise FileError(self.metadata, "", "is missing beside the measured rows")

    def _cut_unfinished(self) -> None:
        """Cuts off what stands after the last end of a line. Raises `FileError`: the file is not of this campaign."""
        header = (",".join(self._columns()) + "\n").encode()
        try:
            content = self.path.read_bytes() if self.path.exists() else b""
            if not header.startswith(content[: len(header)]):
                raise FileError(self.path, "header", "is not that of this campaign", "give another file to write to")
            if (end := content.rfind(b"\n") + 1) < len(content):
                os.truncate(self.path, end)
        except OSError as error:
            raise FileError(self.path, "", f"cannot be read and written ({error.strerror})") from None

    @property
    def metadata(self) -> Path:
        """The metadata file."""
        return self.path.with_suffix(".toml")

    def check_plan(self, sha256: str) -> None:
        """Raises `FileError` if the rows belong to another file of poses."""
        if self.head is not None and self.head.poses_sha256 != sha256:
            raise FileError(self.path, "", "was measured with other poses", "give another file to write to")

    def __enter__(self) -> Self:
        try:
            self._file = self.path.open("ab", buffering=0)
        except OSError as error:
            raise FileError(self.path, "", f"cannot be written ({error.strerror})") from None
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def begin(self, power_on: PowerOn, t: float, arm: str, source: str, **entries: object) -> int:
        """Writes the metadata, of those that there are already the power-on session only; then an empty file's header.

        `t`: the tracker's time now (s), which is that of t_s = 0 in a new file; the others as of `metadata_toml`.
        Returns the session of the next rows: the last row's, or the next one if the servos were switched on anew.
        """
        if self.head is None:
            self._write_metadata(metadata_toml(arm, source, t0_s=t, **entries))
        if not self.path.stat().st_size:
            self._write(",".join(self._columns()))
        return self._open_session(power_on, t)

    def _open_session(self, power_on: PowerOn, t: float) -> int:
        assert self.head is not None
        before = [*self.head.power_ons, *[""] * self.last_session]
        session = self.last_session + (bool(self.done) and before[self.last_session - 1] != power_on.name)
        names = [*before[: session - 1], power_on.name]
        if names != self.head.power_ons:
            content = self.head.model_dump(mode="json", by_alias=True, exclude_none=True)
            earlier = [entry for entry in content["power_on"] if entry["session"] < session]
            if power_on.ago is not None:
                seconds = after_midnight(t - (self.head.t0_s or 0.0), self._last_t)
                begun = {"session": session, "t_s": round(seconds - power_on.ago, 3), "temp_c": power_on.temperature}
                earlier.append({key: value for key, value in begun.items() if value is not None})
            self._write_metadata(tomli_w.dumps(content | {"power_ons": names, "power_on": earlier}))
        return session

    def _write_metadata(self, text: str) -> None:
        write_text(self.metadata, text)
        self.head = read_toml(self.metadata, Metadata)

    def append(self, pose: PlannedPose, arm: ArmState, rest: RestMean) -> None:
        """Writes one row. Raises `FileError`."""
        assert self.head is not None
        self._last_t = after_midnight(rest.t - (self.head.t0_s or 0.0), self._last_t)
        cells = [str(pose.number), f"{self._last_t:.3f}", str(arm.session), f"{pose.payload / GRAM:.3f}"]
        repeat_of = pose.repeat_of if pose.repeat_of in self.done else pose.number
        cells += [f"{math.degrees(q):.6f}" for q in arm.q]
        cells += [f"{value / MM:.4f}" for value in rest.tip.tolist()]
        cells += [f"{max(rest.sd / MM, 1e-4):.4f}", f"{arm.temperature:.2f}", str(repeat_of)]
        cells += [str(side) for side in arm.direction]
        cells += _orientation_cells(rest) if self._orientation else []
        self._write(",".join(cells))
        self.done.append(pose.number)

    def _columns(self) -> list[str]:
        angles = [f"q{i + 1}_deg" for i in range(self._joints)]
        sides = [f"approach{i + 1}" for i in range(self._joints)]
        position = ["x_mm", "y_mm", "z_mm", "sd_mm", "temp_c", "repeat_of"]
        turned = [*QUATERNION, "srot_deg"] if self._orientation else []
        return ["pose", "t_s", "session", "payload_g", *angles, *position, *sides, *turned]

    def _write(self, line: str) -> None:
        try:
            self._file.write(f"{line}\n".encode())
            os.fsync(self._file.fileno())
        except OSError as error:
            raise FileError(self.path, "", f"cannot be written ({error.strerror})") from None


def _orientation_cells(rest: RestMean) -> list[str]:
    """Quaternion and its standard deviation (deg), empty where the tracker did not see it."""
    spread = f"{max(math.degrees(rest.turn_sd or 0.0), LEAST_SROT_DEG):.5f}"
    if rest.rotation is None:
        return [*[""] * len(QUATERNION), spread]
    return [*(f"{value:.7f}" for value in quaternions(rest.rotation[None])[0].tolist()), spread]


def after_midnight(t: float, last: float) -> float:
    """A time (s) by a clock that starts again every midnight, as the first one that is not before `last`."""
    return t + DAY * max(0, math.ceil((last - t) / DAY))
