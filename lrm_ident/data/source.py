"""Where measurements come from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from lrm_math.arm.arm import Arm
from lrm_math.arm.servo_settings import ServoSettings
from lrm_math.errors import FileError
from lrm_math.model.reading import AS_NAMED, Reading


@dataclass(frozen=True)
class Source:
    """Where measurements come from.

    Attributes:
        notices: warnings about the file.
        reading: how the file's numbers were read, where that was said.
        stated: the same with the units of the columns' names.
        left_out: numbers of poses that were taken out.
        arm_name: of a shipped arm, or path of its file, as a model file or the one beside the data names it; None: the
            arm's own name.
        unused: names of the file's columns that nothing is read from.
        servos: settings of the servos that were measured with; None: not known.
    """

    path: Path = Path("computed.csv")
    sha256: str = ""
    notices: tuple[str, ...] = ()
    arm: Arm | None = None
    reading: Reading = AS_NAMED
    stated: Reading = AS_NAMED
    left_out: tuple[int, ...] = ()
    arm_name: str | None = None
    unused: tuple[str, ...] = ()
    servos: ServoSettings | None = None

    def noting(self, *notices: str) -> Source:
        """The same with more warnings."""
        return replace(self, notices=(*self.notices, *notices))

    def fault(self, what: str, right: str = "", place: str = "") -> FileError:
        """The error that names the file, what is wrong (there), and what would be right."""
        return FileError(self.path, place, what, right)


COMPUTED = Source()
"""Of measurements that no file holds."""
