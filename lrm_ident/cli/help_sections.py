"""The help of a command: common options first, then those that only some files need."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from typer.core import TyperCommand

READING = ("unit", "angle_unit", "axes", "frame", "joint_sign", "joint_order", "bad_rows")
RARE = ("force", "effects_file", "cluster", "accept", "take", "connect")
SECTIONS = {"How to read DATA, if its columns do not state it": READING, "Rarely needed": RARE}
"""Sections after the common options, by the names of their parameters."""


class SectionedCommand(TyperCommand):
    """Lists arguments, common options, and then the sections that have any."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Writes the lists."""
        shown = [(each, record) for each in self.get_params(ctx) if (record := each.get_help_record(ctx))]
        reads = {each.name for each, _ in shown} >= set(READING)
        special = {name for names in SECTIONS.values() for name in names} if reads else set(RARE)
        arguments = [record for each, record in shown if each.param_type_name == "argument"]
        common = [r for each, r in shown if each.param_type_name == "option" and each.name not in special]
        write(formatter, "Arguments", arguments)
        write(formatter, "Options", common)
        for title, names in SECTIONS.items():
            write(formatter, title, records(shown, special.intersection(names)))


def records(shown: Collection[tuple[Any, tuple[str, str]]], names: Collection[str]) -> list[tuple[str, str]]:
    """Those of the named parameters, in their order."""
    return [record for each, record in shown if each.name in names]


def write(formatter: Any, title: str, rows: Collection[tuple[str, str]]) -> None:
    """A section, unless it is empty."""
    if rows:
        with formatter.section(title):
            formatter.write_dl(rows)
