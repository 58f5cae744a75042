"""Generates straight-line Python source for the forward kinematics and gravity loads of a given linkage.

Models customised to an arm (Khalil & Kleinfinger 1987): without loops over slots and without products with structural
zeros, one state costs two thirds of the looped recursion.

In the generated code a, b, c and p are columns and origin of the current frame, each with rows x, y and z.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import cos, sin
from typing import Any

import numpy as np

from lrm_math.arrays import Array, Vector3

ROWS = "xyz"
COLUMNS = "abc"
FRAME = ", ".join(f"{column}{row}" for column in "abcp" for row in ROWS)
START = f"{FRAME} = {', '.join(map(str, np.eye(4)[:, :3].ravel().tolist()))}"


def tool_source(welds: Sequence[Array], axes: Sequence[int]) -> str:
    """Source of `tool_frame(amounts)`: the tool frame at slot amounts (V,), rad.

    `welds`: (4, 4) each, from each slot to the next, and from the last to the tool frame. `axes`: index (0 to 2) of the
    axis that each slot turns about.
    """
    lines = [_unpack("q", len(axes), "amounts"), START]
    for v, axis in enumerate(axes):
        lines += [*_weld(welds[v]), *_rotation(v, axis)]
    return _function("tool_frame(amounts)", [*lines, *_weld(welds[-1])], f"({FRAME})")


def state_source(
    welds: Sequence[Array], axes: Sequence[int], inboard_slots: Sequence[int], counted: Sequence[int], gravity: Vector3
) -> str:
    """Source of `state(amounts, bodies)`: tool frame, axes and origins of the slots, and the gravity load on each.

    `inboard_slots`: number of moving slots inboard of each body, ascending. `counted`: first body that each slot's load
    counts. `gravity`: m/s².
    """
    slots, bodies = range(len(axes)), range(len(inboard_slots))
    lines = [_unpack("q", len(axes), "amounts"), *(f"u{b}, v{b}, w{b}, m{b} = bodies[{b}]" for b in bodies), START]
    lines += [_moment(b) for b in bodies if inboard_slots[b] == 0]
    for v, axis in enumerate(axes):
        lines += _weld(welds[v])
        lines += [f"i{v}, j{v}, k{v}, o{v}, r{v}, s{v} = {', '.join(COLUMNS[axis] + row for row in ROWS)}, px, py, pz"]
        lines += _rotation(v, axis)
        lines += [_moment(b) for b in bodies if inboard_slots[b] == v + 1]
    lines += _weld(welds[-1])
    lines += ["x = y = z = m = 0.0", *_loads(counted, len(inboard_slots), gravity)]
    axis_list = ", ".join(f"(i{v}, j{v}, k{v})" for v in slots)
    origin_list = ", ".join(f"(o{v}, r{v}, s{v})" for v in slots)
    tau_list = ", ".join(f"t{v}" for v in slots)
    return _function("state(amounts, bodies)", lines, f"({FRAME}), [{axis_list}], [{origin_list}], [{tau_list}]")


def compile_function(text: str, name: str) -> Any:
    """Compiles generated source, which holds only text from this module and numbers of the model."""
    names: dict[str, Any] = {"cos": cos, "sin": sin}
    exec(compile(text, f"<{name}, unrolled>", "exec"), names)
    return names[name]


def _function(head: str, lines: Sequence[str], answer: str) -> str:
    return "\n    ".join([f"def {head}:", *lines, f"return {answer}\n"])


def _unpack(letter: str, count: int, source: str) -> str:
    return f"[{', '.join(f'{letter}{v}' for v in range(count))}] = {source}"


def _weld(weld: Array) -> Iterator[str]:
    """A rigid transform: translation, then rotation."""
    for row in ROWS:
        if shift := _sum(row, weld[:3, 3].tolist()):
            yield f"p{row} += {shift}"
    changed = [j for j in range(3) if not np.array_equal(weld[:3, j], np.eye(3)[j])]
    for row in ROWS if changed else ():
        old = ", ".join(_sum(row, weld[:3, j].tolist()) for j in changed)
        yield f"{', '.join(COLUMNS[j] + row for j in changed)} = {old}"


def _sum(row: str, shares: Sequence[float]) -> str:
    """One row of a linear combination of the columns, empty where all coefficients are zero."""
    return " + ".join(f"{share!r} * {column}{row}" for column, share in zip(COLUMNS, shares, strict=True) if share)


def _rotation(v: int, axis: int) -> Iterator[str]:
    """Rotation about an axis of the frame by the amount of slot v."""
    one, other = COLUMNS[(axis + 1) % 3], COLUMNS[(axis + 2) % 3]
    yield f"cq, sq = cos(q{v}), sin(q{v})"
    for row in ROWS:
        yield f"{one}{row}, {other}{row} = cq * {one}{row} + sq * {other}{row}, cq * {other}{row} - sq * {one}{row}"


def _moment(b: int) -> str:
    """First mass moment of body b about the base origin (kg m)."""
    parts = (f"a{row} * u{b} + b{row} * v{b} + c{row} * w{b} + p{row} * m{b}" for row in ROWS)
    return f"x{b}, y{b}, z{b} = {', '.join(parts)}"


def _loads(counted: Sequence[int], bodies: int, gravity: Vector3) -> Iterator[str]:
    """Gravity load on every slot, outermost first: axis · (first mass moment of the outboard bodies × gravity)."""
    gx, gy, gz = map(repr, gravity)
    added = bodies
    for v in reversed(range(len(counted))):
        for b in reversed(range(counted[v], added)):
            yield f"x, y, z, m = x + x{b}, y + y{b}, z + z{b}, m + m{b}"
        added = min(added, counted[v])
        yield f"dx, dy, dz = x - m * o{v}, y - m * r{v}, z - m * s{v}"
        yield (
            f"t{v} = i{v} * (dy * {gz} - dz * {gy}) + j{v} * (dz * {gx} - dx * {gz}) + k{v} * (dx * {gy} - dy * {gx})"
        )
