"""One description of a world, and the ways to make one from another: every catalogue is a list of these."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lrm_math.arrays import Array
from validation.hidden_effects.faults.measurement import Fault, GoesOn
from validation.synthetic import ArmDescription, HiddenEffect

Build = Callable[[ArmDescription, int], tuple[HiddenEffect, ...]]
Waits = Callable[[np.random.Generator, int], Array]
"""Seconds (P,) before each of P readings."""
DEG, GRAM, MM, MINUTE_S = math.pi / 180.0, 1e-3, 1e-3, 60.0
LAB, SO101, UR5 = "lrm-lab", "so101-like", "ur5-like"
TWO_LOADS, FIVE_LEVELS_DEG = (0.0, 0.0663), (-80.0, -40.0, 0.0, 40.0, 80.0)
NAMED, TUNE, REPORT = "named", "tune", "report"
UNFORESEEN, BLIND, FRESH = "unforeseen", "blind", "fresh"
MEMORY, MEMORY_BLIND = "memory", "memory-blind"
FAULTS, FAULTS_REPORT, FAULTS_BLIND, FAULTS_BLIND_REPORT = (
    "faults", "faults-report", "faults-blind", "faults-blind-report",
)  # fmt: skip
FIRST_SEED = {
    NAMED: 0, TUNE: 0, REPORT: 1000, UNFORESEEN: 2000, BLIND: 3000, FRESH: 4000, MEMORY: 0, MEMORY_BLIND: 0,
    FAULTS: 3000, FAULTS_REPORT: 4000, FAULTS_BLIND: 3000, FAULTS_BLIND_REPORT: 4000,
}  # fmt: skip
"""By part: where its seeds begin."""
ARM_FILE = Path(__file__).resolve().parents[2] / "config" / "arms" / f"{LAB}.toml"
ARMS = Path(__file__).resolve().parent / "arms"


def stable_seed(*words: object) -> int:
    """A seed that is the same on every machine and in every run (CRC-32)."""
    return zlib.crc32("/".join(str(word) for word in words).encode())


def no_effect(_arm: ArmDescription, _seed: int) -> tuple[HiddenEffect, ...]:
    """Nothing hidden."""
    return ()


@dataclass(frozen=True)
class RandomSizes:
    """The arm, and random draws of a seed: sizes within a quarter of the typical one, and signs."""

    arm: ArmDescription
    rng: np.random.Generator

    def size(self, typical: float) -> float:
        """Between 0.8 and 1.25 of it, to four digits (what a truth file shows)."""
        return float(f"{typical * 0.8 * (1.25 / 0.8) ** self.rng.random():.4g}")

    def sign(self) -> int:
        """-1 or 1."""
        return int(self.rng.choice([-1, 1]))

    def angle(self) -> float:
        """Any angle (rad), to three digits."""
        return round(self.rng.uniform(-math.pi, math.pi), 3)


@dataclass(frozen=True)
class Case:
    """What is hidden in which arm, how the arm is measured, and what may be said of it.

    truths: for each hidden effect the names of the tool, `effect@place`, of which any is right; none if nothing is
    hidden, None if no name fits. part: the catalogue that it belongs to. arm: the lab's, or one of the folder `arms`.
    sessions: number of power-on sessions that the poses are spread over. levels_deg: the only angles of each joint;
    none: any angle. outliers: the share of wrong measurements, which are out by 5 to 25 mm. waits: seconds between
    readings; None: 15. spoil: what goes wrong in the measurement; goes_on: what of it lasts.
    """

    name: str
    truths: tuple[frozenset[str], ...] | None
    build: Build = no_effect
    part: str = NAMED
    arm: str = LAB
    sessions: int = 1
    loads_kg: tuple[float, ...] = TWO_LOADS
    levels_deg: tuple[float, ...] = ()
    outliers: float = 0.0
    waits: Waits | None = None
    spoil: Fault | None = None
    goes_on: GoesOn = GoesOn.NOTHING
    noise_known: bool = True

    @property
    def key(self) -> str:
        """Its name among all catalogues."""
        return self.name if self.part == NAMED else f"{self.name}/{self.part}"

    @property
    def truth(self) -> tuple[str, ...] | None:
        """All names that are right; None: no name fits."""
        return None if self.truths is None else tuple(name for right in self.truths for name in sorted(right))

    @property
    def truth_words(self) -> str:
        """The same, for a table."""
        if self.truths is None:
            return "no name fits"
        return " + ".join(" or ".join(sorted(right)) for right in self.truths) or "nothing"

    @property
    def arm_file(self) -> Path:
        """The description of the arm."""
        return ARM_FILE if self.arm == LAB else ARMS / f"{self.arm}.toml"

    @property
    def group(self) -> str:
        """The row of a table of totals."""
        if self.spoil is not None and "healthy" not in self.name:
            return "a fault of the measurement"
        if self.truths is None:
            return "outside the catalogue"
        return ("nothing hidden", "one effect", "two effects", "three effects")[len(self.truths)]


def hidden(
    part: str, name: str, right: str | None, make: Callable[[RandomSizes], HiddenEffect], sessions: int = 1
) -> Case:
    """A case with one effect. right: the names that fit it, by spaces; None if none does."""

    def build(arm: ArmDescription, seed: int) -> tuple[HiddenEffect, ...]:
        return (make(RandomSizes(arm, np.random.default_rng(stable_seed(name, seed, "sizes")))),)

    truths = None if right is None else (frozenset(right.split()),)
    return Case(name, truths, build, part, sessions=sessions)


def nothing(part: str) -> Case:
    """No hidden effect."""
    return Case("nothing", (), part=part)


def together(*cases: Case) -> Case:
    """The effects of all of them, in the data of the first."""

    def build(arm: ArmDescription, seed: int) -> tuple[HiddenEffect, ...]:
        return tuple(effect for case in cases for effect in case.build(arm, seed))

    truths = tuple(right for case in cases for right in case.truths or ())
    sessions = max(case.sessions for case in cases)
    name = "+".join(case.name for case in cases)
    return replace(cases[0], name=name, truths=truths, build=build, sessions=sessions)


def of_part(part: str, case: Case) -> Case:
    """The same in another catalogue, with other seeds."""
    return replace(case, part=part)


def on(arm: str, case: Case) -> Case:
    """The same on another arm."""
    return replace(case, arm=arm, name=f"{case.name} on {arm}")


def one_load(case: Case) -> Case:
    """The same, measured without load only."""
    return replace(case, loads_kg=(0.0,), name=f"{case.name}, one load")


def five_levels(case: Case) -> Case:
    """The same, measured at five angles of each joint."""
    return replace(case, levels_deg=FIVE_LEVELS_DEG, name=f"{case.name}, five levels")


def with_outliers(case: Case) -> Case:
    """The same with one wrong measurement in twenty."""
    return replace(case, outliers=0.05, name=f"{case.name}, outliers")


def by_key(*cases: Case) -> dict[str, Case]:
    """Cases by their keys."""
    return {case.key: case for case in cases}
