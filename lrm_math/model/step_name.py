"""What a step of a model's history did: its kind, and the effect, prior or bench that it was taken with."""

from __future__ import annotations

import re
from typing import NamedTuple

FIT, ADD, REFIT, TRANSFER, LEAVE_OUT, FREE = "fit", "add", "refit", "transfer", "leave_out", "free"
NAMES = {
    ADD: "add {of}", REFIT: "with the prior {of}", TRANSFER: "transfer from {of}", LEAVE_OUT: "without outliers",
    FREE: "all offsets and compliances",
}  # fmt: skip
"""Names of steps whose kind is no name by itself; others are their own names."""
VERSION_1 = re.compile(r"add (?P<add>[^\s,]+)(?:, .*)?|with the prior (?P<refit>.+)|transfer from (?P<transfer>.+)")
"""A step as files of `lrm/model/1` name it, with what could not be told from the effect behind a comma."""


class StepName(NamedTuple):
    """A step: `kind`, and what it was taken `of`: an effect that was added, the prior of a refit, another bench.

    As text `fit`, `add backlash@joint2`.
    """

    kind: str
    of: str = ""

    @classmethod
    def of_version_1(cls, name: str) -> StepName:
        """From its name in a file of `lrm/model/1`; what is none of the known ones is a kind of its own."""
        match = VERSION_1.fullmatch(name)
        return cls(name) if match is None else next(cls(kind, of) for kind, of in match.groupdict().items() if of)

    @property
    def added(self) -> str:
        """The effect that was added (`id@place`), "" where none was."""
        return self.of if self.kind == ADD else ""

    def __str__(self) -> str:
        return NAMES.get(self.kind, self.kind).format(of=self.of).rstrip()
