"""All worlds, by part and by key."""

from __future__ import annotations

from validation.hidden_effects.case import FAULTS_BLIND_REPORT, FAULTS_REPORT, FIRST_SEED, Case, by_key, of_part
from validation.hidden_effects.cases import CASES
from validation.hidden_effects.faults.cases import BLIND_FAULTS, FAULT_CASES
from validation.hidden_effects.memory import BLIND_WORLDS, WORLDS
from validation.hidden_effects.other_forms import REPORTING, TUNING
from validation.hidden_effects.unforeseen import BLIND_CASES, FIRST, FRESH_CASES

UNFAMILIAR = by_key(*TUNING, *REPORTING, *FIRST, *BLIND_CASES, *FRESH_CASES)
"""Worlds whose effects have another form than the tool's, or no name."""
FAULTY = by_key(
    *FAULT_CASES,
    *BLIND_FAULTS,
    *(of_part(FAULTS_REPORT, case) for case in FAULT_CASES),
    *(of_part(FAULTS_BLIND_REPORT, case) for case in BLIND_FAULTS),
)
MEMORIES = by_key(*WORLDS, *BLIND_WORLDS)
EVERY: dict[str, Case] = CASES | UNFAMILIAR | FAULTY | MEMORIES
PARTS = {part: {key: case for key, case in EVERY.items() if case.part == part} for part in FIRST_SEED}
