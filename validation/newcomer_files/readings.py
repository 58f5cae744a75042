"""Random single changes of how angles and arms are meant: a seam, a zero, a prefix, a coupling, gravity."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from lrm_math.arrays import Array
from validation.newcomer_files.changes import Change, FileChange
from validation.newcomer_files.healthy import NewcomerFiles

GRAVITY = re.compile(r"^gravity_m_per_s2 = .*$", re.MULTILINE)


def _about(name: str) -> tuple[str, ...]:
    return name, f"joint {name[1:-4]}:", f"joint {name[1:-4]} ", f"joint{name[1:-4]}", "which column is which joint"


def seam(files: NewcomerFiles, rng: np.random.Generator) -> FileChange:
    """A joint that is a full turn away, in all rows, beyond an angle, or in one row."""
    name, turn = str(rng.choice(files.angles)), 360.0 * float(rng.choice([-1, 1]))
    kind, row = str(rng.choice(["all", "beyond", "one"])), int(rng.integers(len(files.rows)))

    def wrapped(angles: Array) -> Array:
        far = {"all": angles > -np.inf, "beyond": angles > np.median(angles), "one": np.arange(len(angles)) == row}
        return np.asarray(angles + turn * far[kind])

    words = (*_about(name), "beyond", "full turn", f"pose {files.rows[row][0]}:")
    return FileChange(f"{name} {turn:+g} deg ({kind})", files.with_column(name, wrapped), words)


def convention(files: NewcomerFiles, rng: np.random.Generator) -> FileChange:
    """A joint that is counted from another zero, perhaps the other way."""
    name, zero = str(rng.choice(files.angles)), float(rng.choice([-180, -90, 90, 180]))
    way = float(rng.choice([-1.0, 1.0]))
    return FileChange(f"{name} = {zero:g} {way:+g} q", files.with_column(name, lambda q: zero + way * q), _about(name))


def prefix(files: NewcomerFiles, rng: np.random.Generator) -> FileChange:
    """Names of joints with something before or after them."""
    before, after = rng.choice(["arm_", "left_", "right_", "main_", "follower_", ""]), rng.choice(["", ".pos", "_cmd"])
    header = [f"{before}{name}{after}" if name in files.angles else name for name in files.header]
    words = ("header", "column", "joint", "read as", *files.angles)
    return FileChange(
        f"angles called '{before}q1_deg{after}'", files.with_rows([*map(list, files.rows)], header), words
    )


def mimic(files: NewcomerFiles, rng: np.random.Generator) -> FileChange:
    """A joint that is counted with another one, as rods couple them: its angle in the room, not that of its motor."""
    names = files.angles
    number = int(rng.integers(1, len(names)))
    leader, ratio = files.column(names[number - 1]), float(rng.choice([-1.0, 1.0]))
    led = np.array([float(row[leader]) for row in files.rows])
    words = (*_about(names[number]), *_about(names[number - 1]))
    what = f"{names[number]} counts {ratio:+g} {names[number - 1]} too"
    return FileChange(what, files.with_column(names[number], lambda q: q + ratio * led), words)


def gravity(files: NewcomerFiles, rng: np.random.Generator) -> FileChange:
    """Gravity of the arm's file in another direction or unit."""
    x, y, z = rng.choice(
        np.array([[0, 0, 9.81], [9.81, 0, 0], [0, -9.81, 0], [0, 0, -9810], [0, 0, -981], [0, 0, -1], [0, 0, 0]])
    )
    text = GRAVITY.sub(f"gravity_m_per_s2 = [{x}, {y}, {z}]", files.arm)
    return FileChange(f"gravity {x:g}, {y:g}, {z:g}", replace(files, arm=text), ("gravity",))


READINGS: dict[str, Change] = {
    "seam": seam,
    "convention": convention,
    "prefix": prefix,
    "mimic": mimic,
    "gravity": gravity,
}
