"""Evidence: what speaks for an effect that was added, from the diagnosis that chose it to the card of its step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Evidence:
    """What is known of an effect that was added.

    Attributes:
        equivalent: the other effects of its equivalence class, which these data cannot distinguish from it.
        rivals: held-out RMS of the tip (m) that the next best effects outside its class would have left alone, the
            least first; None where that is not known.
        refitted: those of the rivals that were refitted; of the others it is an estimate of the linear screening.
        refines: the effects, `effect@place`, of which it is another form. of_present: whether one of them is there.
        explained: held-out mean square (m²) that it took away. share: of that above the noise (of all, where that is
            unknown). Both at the poses that the diagnosis before it kept: with the effect, others may be outliers.
        describes: whether it only describes (`ConfirmedDiagnosis.describes`).
        replicates: whether it was chosen in both halves of the data.
        misspecified: whether what it follows moves the arm otherwise, too (`specification_test`).
    """

    equivalent: tuple[str, ...] = ()
    rivals: Mapping[str, float] | None = None
    refitted: tuple[str, ...] = ()
    refines: tuple[str, ...] = ()
    of_present: bool = False
    explained: float = 0.0
    share: float = 0.0
    describes: bool = False
    replicates: bool = True
    misspecified: bool = False


NO_EVIDENCE = Evidence()
