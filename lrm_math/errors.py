"""The exceptions that users may see: one line with what is wrong, where, and what would be right."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from traceback import StackSummary, walk_tb
from typing import Any


class LrmError(Exception):
    """The base class of all errors raised on purpose; pickled with their attributes between processes."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (type(self), self.args, self.__dict__)

    def _render_traceback_(self) -> list[str]:
        """Lines that IPython shows in place of a traceback: those of the user's own cells, the message, its notes."""
        frames_of_main = [
            pair for pair in walk_tb(self.__traceback__) if pair[0].f_globals.get("__name__") == "__main__"
        ]
        lines = [f"line {frame.lineno}: {frame.line}" for frame in StackSummary.extract(iter(frames_of_main))]
        return [*lines, f"{type(self).__name__}: {self}", *getattr(self, "__notes__", ())]


def _rebuilt(kind: type[LrmError], args: tuple[Any, ...], attributes: dict[str, Any]) -> LrmError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(attributes)
    return error


class FileError(LrmError):
    """A file that is not valid.

    Attributes: `path`, `where` (row, column, joint or key, may be empty), `what` is wrong, `expected` instead.
    """

    def __init__(self, path: object, where: str, what: str, expected: str = "") -> None:
        self.path, self.where, self.what, self.expected = str(path), where, what, expected
        message = ": ".join(part for part in (self.path, where, what) if part)
        super().__init__(f"{message}; {expected}" if expected else message)


class FileFaults(FileError):
    """A file with several faults; carries them all as `faults`."""

    def __init__(self, path: object, faults: Sequence[FileError]) -> None:
        self.faults = tuple(faults)
        super().__init__(path, "", f"{len(self.faults)} faults")
        lines = (str(fault).removeprefix(f"{self.path}: ") for fault in self.faults)
        self.args = ("\n  ".join([f"{self.path}: {self.what}:", *lines]),)


def raise_faults(path: object, faults: Sequence[FileError]) -> None:
    """Raises the one fault, or all of them together; nothing if there are none."""
    if faults:
        raise faults[0] if len(faults) == 1 else FileFaults(path, faults)


class UnknownName(LrmError):
    """A name that is not in the list of valid ones; carries `name` and `valid`. `more`: what else may be wrong."""

    def __init__(self, kind: str, name: str, valid: Iterable[str], more: str = "") -> None:
        self.name, self.valid = name, tuple(valid)
        hints = filter(None, (name_suggestion(name, self.valid), more))
        super().__init__(f"unknown {kind} '{name}'; {'; '.join(hints)}")


class NoEquilibrium(LrmError):
    """No elastic equilibrium in the range of the model at the poses with the numbers `poses`."""

    def __init__(self, poses: Sequence[int], why: str) -> None:
        self.poses = tuple(poses)
        others = f" and {len(poses) - 1} more" if len(poses) > 1 else ""
        super().__init__(
            f"pose {poses[0]}{others}: the elastic equilibrium does not settle ({why}); "
            "compliances of printed arms are 0.02 to 0.2 rad/Nm"
        )


def name_suggestion(name: str, valid: Sequence[str]) -> str:
    """A hint for a wrong name: the closest valid ones first, then the whole list if it is short.

    Names that differ in a number only are in no way closer than others of the list.
    """
    bare = _without_digits(name)
    numbered = [other for other in valid if _without_digits(other) == bare]
    others = [other for other in valid if len(valid) > 12 or other not in numbered]
    close = difflib.get_close_matches(name, others, n=3, cutoff=0.6)
    if close:
        hint = "did you mean " + " or ".join(close) + "?"
        return hint if len(valid) > 12 else f"{hint} valid: {', '.join(valid)}"
    return "valid: " + ", ".join(valid)


def _without_digits(name: str) -> str:
    return "".join(c for c in name if not c.isdigit())
