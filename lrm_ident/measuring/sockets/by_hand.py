"""Touches by hand: the servos limp, the tip held in a socket, the encoders read when a person says so."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurement_file.known_columns import ANGLE
from lrm_ident.data.measurement_file.pose_quantity import PLACEMENT, POINT
from lrm_ident.data.table_text.csv_file import read_table
from lrm_math.errors import FileError, LrmError

READINGS, PAUSE_S, STILL = 10, 0.05, math.radians(0.5)
"""Readings of a touch, s between them, and rad that a joint may move meanwhile."""
END = "end"
NEXT = "board"
HELP = f"Enter: the tip rests in it; a name: another socket; '{NEXT} NAME': the board stands elsewhere; '{END}'"


class LimpServos(Protocol):
    """Servos that a hand moves."""

    def angles(self) -> tuple[float, ...]:
        """(n,), what the encoders read (rad)."""


@dataclass
class TouchLog:
    """File of touches, on the disk after each; one that is there goes on. Raises `FileError`."""

    path: Path
    joints: int
    count: int = 0
    placements: list[str] = field(default_factory=list)
    text: str = ""

    def __post_init__(self) -> None:
        header = ["pose", *(ANGLE.format(k) for k in range(1, self.joints + 1)), POINT, PLACEMENT]
        if not self.path.exists() or not self.path.stat().st_size:
            self._write(",".join(header))
            return
        table = read_table(self.path)
        if list(table.header) != header:
            raise FileError(self.path, "header", "is not that of touches of this arm", "give another file to write to")
        self.text = self.path.read_text(encoding="utf-8")
        self.count = max((int(row[0]) for row in table.rows), default=0)
        self.placements = list(dict.fromkeys(row[-1] for row in table.rows))

    def append(self, q: Sequence[float], point: str, placement: str) -> None:
        """Writes a touch; `q`: (n,), rad."""
        self.count += 1
        self.placements += [placement] * (placement not in self.placements)
        self._write(",".join([str(self.count), *(f"{math.degrees(angle):.4f}" for angle in q), point, placement]))

    def _write(self, line: str) -> None:
        self.text += f"{line}\n"
        write_text(self.path, self.text)


def record_touches(
    servos: LimpServos,
    log: TouchLog,
    points: Sequence[str],
    ask: Callable[[str], str],
    say: Callable[[str], object],
    sleep: Callable[[float], object],
) -> int:
    """Asks for one touch after the other, socket by socket, until a person ends it; the number of touches.

    Args:
        points: names of the sockets, in the order in which they are proposed.
        ask: shows a question and gives the answer, or raises `EOFError`.
    """
    placement, turn, begun = (log.placements or ["1"])[-1], log.count, log.count
    say(HELP)
    while True:
        point = points[turn % len(points)]
        try:
            answer = ask(f"touch {log.count + 1}, board at {placement}, socket {point}: ").strip()
        except EOFError:
            answer = END
        word, _, name = answer.partition(" ")
        if answer == END:
            return log.count - begun
        if word == NEXT and name.strip():
            placement = name.strip()
        elif answer in points:
            turn = points.index(answer)
        elif answer:
            say(f"'{answer}' is none of {', '.join(points)}. {HELP}")
        elif isinstance(q := _still(servos, sleep), str):
            say(q)
        else:
            log.append(q, point, placement)
            turn += 1


def _still(servos: LimpServos, sleep: Callable[[float], object]) -> tuple[float, ...] | str:
    """(n,), mean of some readings (rad); in words, which joint moved meanwhile."""
    readings = []
    for _ in range(READINGS):
        readings.append(servos.angles())
        sleep(PAUSE_S)
    moved = np.ptp(np.array(readings), axis=0)
    if moved.max() > STILL:
        joint = int(np.argmax(moved))
        return f"joint {joint + 1} moved by {math.degrees(moved[joint]):.1f} deg: not kept; hold still and press Enter"
    return tuple(np.mean(readings, axis=0).tolist())


def points_to_touch(names: str, points: Sequence[str]) -> list[str]:
    """Names of sockets by commas, or those known. Raises `LrmError`: there are none, one stands twice, or is a
    word that means something else."""
    chosen = [word.strip() for word in names.split(",") if word.strip()] or list(points)
    if not chosen or len(set(chosen)) < len(chosen) or {END, NEXT} & {*chosen}:
        raise LrmError(f"--points {names}: should be names of sockets by commas, each once, such as A,B,C,D,E")
    return chosen
