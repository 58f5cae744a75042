"""The card of a data set that others are to use: `[card]` in the metadata file beside the measurements."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from lrm_math.toml_file import StrictSchema

OPEN_LICENCES = ("CC0-1.0", "CC-BY-4.0", "CC-BY-SA-4.0", "ODbL-1.0", "ODC-By-1.0", "PDDL-1.0", "MIT", "BSD-3-Clause")
"""Identifiers of SPDX of licences under which others may use data."""
Words = Annotated[str, Field(min_length=1)]


class DatasetCard(StrictSchema):
    """Facts that a stranger must know of a data set.

    Attributes:
        arm: make, material, servos and tool. instrument: what measured the tip. noise: how its noise is known.
        licence: an identifier of SPDX. date: of the measurement, as 2024-07-15. url: where the data come from.
    """

    title: Words | None = Field(None, description="One line: which arm, how many poses, what is special.")
    arm: Words | None = Field(None, description="Make, material, servos and tool of the arm.")
    instrument: Words | None = Field(None, description="What measured the tip: maker, kind, distance.")
    noise: Words | None = Field(None, description="How the noise is known: repeats, data sheet, a guess.")
    date: Annotated[str, Field(pattern=r"^\d{4}(-\d{2}(-\d{2})?)?$")] | None = Field(
        None, description="Day of the measurement: 2024-07-15, 2024-07 or 2024."
    )
    authors: list[Words] = Field([], description="Who measured.")
    licence: Words | None = Field(None, description=f"Identifier of SPDX: {', '.join(OPEN_LICENCES)}.")
    url: Words | None = Field(None, description="Where the data come from, or are described (optional).")


OPTIONAL = ("url",)


def card_faults(card: DatasetCard | None) -> dict[str, str]:
    """Facts that a card lacks for others to use the data, by field: what would be right."""
    stated = card or DatasetCard()
    faults = {
        name: str(field.description)
        for name, field in DatasetCard.model_fields.items()
        if name not in OPTIONAL and not getattr(stated, name)
    }
    if stated.licence and stated.licence not in OPEN_LICENCES:
        faults["licence"] = f"'{stated.licence}' is none of {', '.join(OPEN_LICENCES)}"
    return faults
