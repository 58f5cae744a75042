"""From the results of the arms to the result of the fleet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lrm_ident.fleet.fleet_findings import outliers, tag_associations
from lrm_ident.fleet.fleet_prior import FleetKnowledge, arm_estimates, fleet_knowledge
from lrm_ident.fleet.fleet_report import FleetResult
from lrm_ident.fleet.identify_arm import ArmRecord
from lrm_ident.fleet.manifest import FleetMember
from lrm_math.errors import LrmError


def fleet_result(members: Sequence[FleetMember], records: Sequence[ArmRecord], models: Path) -> FleetResult:
    """What the arms that have a model have in common, and which stand out; arms that stand out are left out of it.

    Args:
        models: folder of the model files.
    """
    done = [(member, record) for member, record in zip(members, records, strict=True) if not record.reason]
    estimates = [arm_estimates(record, models) for _, record in done]
    found = outliers([record for _, record in done], estimates)
    odd = {one.arm for one in found}
    kept = [number for number, (_, record) in enumerate(done) if record.name not in odd]
    sisters, theirs = [done[number][1] for number in kept], [estimates[number] for number in kept]
    known: FleetKnowledge | str
    try:
        known = fleet_knowledge(sisters, theirs)
    except LrmError as error:
        known = str(error)
    rates = () if isinstance(known, str) else known.rates
    return FleetResult(
        members=tuple(members),
        records=tuple(records),
        estimates={record.name: one for (_, record), one in zip(done, estimates, strict=True)},
        known=known,
        links=tag_associations([done[number][0] for number in kept], sisters, theirs, rates) if sisters else (),
        outliers=found,
    )
