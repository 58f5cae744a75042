"""Result of the fleet from the results of the arms."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

from lrm_ident.fleet.fleet_findings import outliers, tag_associations
from lrm_ident.fleet.fleet_prior import ArmEstimates, FleetKnowledge, arm_estimates, fleet_knowledge
from lrm_ident.fleet.fleet_report import FleetResult
from lrm_ident.fleet.identify_arm import ArmRecord
from lrm_ident.fleet.manifest import FleetMember
from lrm_math.errors import LrmError
from lrm_math.model.model_file import arm_of


def fleet_result(members: Sequence[FleetMember], records: Sequence[ArmRecord], models: Path) -> FleetResult:
    """Summary of the arms that have a model, and of those that stand out, which are left out of it.

    Args:
        models: folder of the model files.
    """
    arm_named = cache(lambda name: arm_of(models / "NAME.toml", name))
    done, estimates = list[tuple[FleetMember, ArmRecord]](), list[ArmEstimates]()
    for member, record in zip(members, records, strict=True):
        if record.evidence is not None:
            done.append((member, record))
            estimates.append(arm_estimates(record.name, record.evidence, arm_named(record.evidence.arm)))
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
