"""Result of `lrm-ident fleet`: one table of the arms, and what they have in common."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from lrm_ident.data.wording import p_words, quantity
from lrm_ident.fleet.effect_rates import EffectRate
from lrm_ident.fleet.fleet_findings import FleetOutlier, TagAssociation, outliers, tag_associations
from lrm_ident.fleet.fleet_prior import ArmEstimates, FleetKnowledge, arm_estimates, fleet_knowledge, parameter_values
from lrm_ident.fleet.identify_arm import ArmRecord
from lrm_ident.fleet.manifest import FleetMember
from lrm_ident.report.document import Block, Document, ResultTable, heading, section
from lrm_math.arm.arm_file import arm_of
from lrm_math.effects import ParameterRef
from lrm_math.errors import LrmError

MOST_RATES, MOST_CAUSES = 20, 2


@dataclass(frozen=True, eq=False)
class FleetResult:
    """A fleet that was identified.

    Attributes:
        estimates: parameters of each arm with a model, by name. known: what they have in common, or the reason why
            nothing can be said. outliers: parameters of an arm, not part of what is common.
    """

    members: tuple[FleetMember, ...]
    records: tuple[ArmRecord, ...]
    estimates: dict[str, ArmEstimates]
    known: FleetKnowledge | str
    links: tuple[TagAssociation, ...]
    outliers: tuple[FleetOutlier, ...]

    @property
    def tags(self) -> list[str]:
        """Names of the manifest's tags."""
        return list(dict.fromkeys(name for member in self.members for name, _ in member.tags))


def fleet_document(result: FleetResult) -> Document:
    """Schema `lrm/fleet/1`: every arm's row, rates, population, tags, outliers."""
    done = [record for record in result.records if not record.reason]
    broken = [f"{record.name}: {record.reason}" for record in result.records if record.reason]
    values: dict[str, object] = {
        "arms": [_row(member, record) for member, record in zip(result.members, result.records, strict=True)],
        "outliers": result.outliers,
        "tags": result.links,
    }
    blocks: list[Block] = [heading(f"{len(done)} of {len(result.records)} arms identified"), _arms_table(result)]
    blocks += section("\nNot identified", broken)
    blocks += section("\nArms unlike their sisters", map(outlier_sentence, result.outliers))
    blocks += section("\nWhat goes with a tag", map(_link_words, result.links))
    if isinstance(result.known, str):
        blocks.append(f"\nNo prior: {result.known}")
        values |= {"rates": [], "population": {}, "reason": result.known}
    else:
        rates = _rates_table(result.known)
        blocks += [rates if rates.cells else "\nNo arm has an effect beyond the plain model."]
        blocks += [_population_table(result.known)]
        values |= {"rates": result.known.rates, "population": parameter_values(result.known)}
    return Document(blocks, "lrm/fleet/1", values)


def table_csv(result: FleetResult) -> str:
    """One row per arm: its tags, result, and every parameter with its standard error (`_se`), unrounded."""
    columns = fleet_columns(result)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow(["" if cell is None else cell for cell in row])
    return text.getvalue()


def table_parquet(result: FleetResult) -> bytes | None:
    """The table as Parquet; None where pyarrow (extra `lerobot`) is not installed."""
    if find_spec("pyarrow") is None:
        return None
    import pyarrow
    import pyarrow.parquet as parquet

    buffer: Any = pyarrow.BufferOutputStream()
    parquet.write_table(pyarrow.table(fleet_columns(result)), buffer)
    return bytes(buffer.getvalue().to_pybytes())


def fleet_columns(result: FleetResult) -> dict[str, list[Any]]:
    """Columns of the table by name."""
    rows = [_row(member, record) for member, record in zip(result.members, result.records, strict=True)]
    columns = {name: [row.get(name) for row in rows] for name in dict.fromkeys(name for row in rows for name in row)}
    columns["effects"] = [" ".join(names or ()) for names in columns["effects"]]
    keys = dict.fromkeys(key for estimate in result.estimates.values() for key in estimate.keys)
    for key in keys:
        pairs = [_estimate(result.estimates.get(record.name), key) for record in result.records]
        columns[key], columns[f"{key}_se"] = [value for value, _ in pairs], [error for _, error in pairs]
    return columns


def _estimate(estimates: ArmEstimates | None, key: str) -> tuple[float | None, float | None]:
    """Value and standard error in the unit of the key."""
    if estimates is None or key not in estimates.keys:
        return None, None
    j, scale = estimates.keys.index(key), estimates.typical_of(key)
    return float(estimates.mean[j] * scale), float(np.sqrt(estimates.covariance[j, j]) * scale)


def _row(member: FleetMember, record: ArmRecord) -> dict[str, Any]:
    return {
        "name": record.name,
        **{f"tag {name}": cell for name, cell in member.tags},
        "poses": record.poses,
        "verdict": record.verdict,
        "effects": [step[0] for step in record.steps],
        "nominal_rms_mm": record.nominal_rms_mm,
        "fit_rms_mm": record.fit_rms_mm,
        "held_out_rms_mm": record.held_out_rms_mm,
        "seconds": record.seconds,
        "reason": record.reason,
    }


def _arms_table(result: FleetResult) -> ResultTable:
    tags, rows = result.tags, []
    for member, record in zip(result.members, result.records, strict=True):
        tags_of_arm, causes = dict(member.tags), ", ".join(map(causes_words, record.steps))
        missing = "not identified" if record.reason else causes or "nothing"
        numbers = (record.poses or None, record.nominal_rms_mm, record.held_out_rms_mm)
        rows.append((record.name, *(tags_of_arm.get(tag, "") for tag in tags), *numbers, missing))
    columns = ("arm", *tags, "poses|d", "nominal RMS mm|.2f", "held out mm|.2f", "what is missing in the plain model")
    return ResultTable(columns, rows, "Arms")


def causes_words(causes: Sequence[str]) -> str:
    """Causes that one arm's data cannot tell apart; of many the first ones."""
    return " or ".join(causes[:MOST_CAUSES]) + (" or …" if len(causes) > MOST_CAUSES else "")


def rate_words(rate: EffectRate) -> str:
    """Words such as `3 of 3 arms (of the kind: 29 to 99 %)`: what was seen, and what that says of arms not seen."""
    count_words = f"{rate.found:.2g}" if rate.found < 10 else f"{rate.found:.0f}"  # unsure arms count in part
    return f"{count_words} of {rate.arms} arms (of the kind: {_interval(rate)} %)"


def _interval(rate: EffectRate) -> str:
    """The 95 % interval in whole percents, as `29 to 99`; a few arms say no more."""
    return f"{100.0 * rate.low:.0f} to {100.0 * rate.high:.0f}"


def outlier_sentence(outlier: FleetOutlier) -> str:
    """What stands out in an arm, with what to look at."""
    what, place, name = ParameterRef.parse(outlier.key)
    ratio = outlier.value / outlier.sisters if outlier.sisters else 0.0
    how = f"{ratio:.2g} times that of its sisters" if ratio >= 1.5 else "unlike its sisters"
    look = "check its screws and its servo" if what == "compliance" else "check how it is screwed together"
    return (
        f"{outlier.arm}: {place}'s {what} {name} is {outlier.value:.3g}, {how} "
        f"({quantity(outlier.sisters, outlier.sisters_sd)}): {look}"
    )


def _link_words(link: TagAssociation) -> str:
    levels = "; ".join(f"{level or '(none)'}: {seen}" for level, seen in link.levels)
    return f"{link.what} goes with {link.tag} (p {p_words(link.p_value)}): {levels}"


def _rates_table(knowledge: FleetKnowledge) -> ResultTable:
    rows = [
        (effect_rate.name, effect_rate.found, effect_rate.arms, _interval(effect_rate))
        for effect_rate in knowledge.rates[:MOST_RATES]
        if effect_rate.found > 0
    ]
    columns = ("effect", "found|.1f", "of arms|d", "of the kind (95 %), %|")
    return ResultTable(columns, rows, "How often an effect is there")


def _population_table(knowledge: FleetKnowledge) -> ResultTable:
    rows = []
    for key, table in parameter_values(knowledge).items():
        low, high = table["mean_interval"]
        least, most = table["spread_interval"]
        rows.append(
            (key, table["mean"], f"{low:.3g} … {high:.3g}", table["spread"], f"{least:.2g} … {most:.2g}", table["arms"])
        )
    columns = ("parameter", "mean|.4g", "95 %|", "spread|.3g", "95 %|", "arms|d")
    return ResultTable(columns, rows, "What the arms have in common: mean, and spread from arm to arm")


def fleet_result(members: Sequence[FleetMember], records: Sequence[ArmRecord], models: Path) -> FleetResult:
    """Summary of the arms that have a model, and of those that stand out, which are left out of it.

    Args:
        models: folder of the model files.
    """
    arm_named = cache(lambda name: arm_of(models / "NAME.toml", name))
    pairs = zip(members, records, strict=True)
    done = [(m, r, arm_estimates(r.name, r.evidence, arm_named(r.evidence.arm))) for m, r in pairs if r.evidence]
    odd_arms = outliers([record for _, record, _ in done], [estimates_of_arm for *_, estimates_of_arm in done])
    odd = {outlier.arm for outlier in odd_arms}
    kept = [item for item in done if item[1].name not in odd]
    sisters, theirs = [record for _, record, _ in kept], [estimates_of_arm for *_, estimates_of_arm in kept]
    knowledge: FleetKnowledge | str
    try:
        knowledge = fleet_knowledge(sisters, theirs)
    except LrmError as error:
        knowledge = str(error)
    rates = () if isinstance(knowledge, str) else knowledge.rates
    return FleetResult(
        members=tuple(members),
        records=tuple(records),
        estimates={record.name: estimates_of_arm for _, record, estimates_of_arm in done},
        known=knowledge,
        links=tag_associations([member for member, *_ in kept], sisters, theirs, rates) if kept else (),
        outliers=odd_arms,
    )
