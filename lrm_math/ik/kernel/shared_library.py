"""The compiled kernel, found beside its source, checked and loaded once; its structures and fixed maxima.

It is built by `hatch_build.py` at the root of the project when the package is installed or a wheel is made.
"""

from __future__ import annotations

import ctypes
import sys
import zlib
from functools import cache
from pathlib import Path

from lrm_math.errors import LrmError

MAX_SLOTS, MAX_JOINTS, MAX_BODIES, MAX_LAWS, MAX_SPRINGS, MAX_FOUND = 48, 16, 20, 96, 256, 48
MAX_POSES, MAX_TERMS = 2048, 128
BRANCHES = 8
Real, Integer, Pointer = ctypes.c_double, ctypes.c_int, ctypes.c_void_p


class KernelForm(ctypes.Structure):
    """`Form`: constants of the closed form, see `pieper.PieperForm`."""

    _fields_ = [
        ("frame", Real * 9), ("foot", Real * 3), ("centre", Real * 3), ("tip_x", Real * 3), ("tip_z", Real * 3),
        ("a", Real), ("links", Real * 10), ("offsets", Real * 4), ("v0", Real * 3), ("vc", Real * 3),
        ("vs", Real * 3), ("elbow", Real * 3), ("length", Real), ("shape", Integer), ("backwards", Integer),
    ]  # fmt: skip


class KernelArm(ctypes.Structure):
    """`Arm`: one model with one payload."""

    _fields_ = [
        *((name, Integer) for name in ("slots", "joints", "others", "bodies", "laws", "poses", "has_form")),
        ("laws_known", Integer), ("gravity", Real * 3), ("reach", Real), ("nonlinear_bound", Real),
        ("fixed", Real * (12 * (MAX_SLOTS + 1))), ("moment", Real * (4 * MAX_BODIES)),
        ("fixed_turn", Integer * (MAX_SLOTS + 1)), ("axis", Integer * MAX_SLOTS),
        ("mimics", Integer), ("mimic", Integer * MAX_JOINTS), ("leader", Integer * MAX_JOINTS),
        ("ratio", Real * MAX_JOINTS),
        ("joint", Integer * MAX_JOINTS), ("other", Integer * MAX_SLOTS), ("inboard", Integer * MAX_BODIES),
        ("counted", Integer * MAX_SLOTS), ("moved", Integer * MAX_SLOTS),
        ("zero", Real * MAX_SLOTS), ("start", Real * MAX_SLOTS),
        ("lower", Real * MAX_JOINTS), ("upper", Real * MAX_JOINTS),
        ("spring_from", Integer * (MAX_SLOTS + 1)), ("spring_load", Integer * MAX_SPRINGS),
        ("spring", Real * MAX_SPRINGS), ("play", Real * MAX_SLOTS), ("play_force", Real * MAX_SLOTS),
        ("law", Integer * MAX_LAWS), ("law_joint", Integer * MAX_LAWS), ("law_p", Real * (4 * MAX_LAWS)),
        ("terms", Integer), ("term_axis", Integer * MAX_TERMS), ("term_factor", Integer * (3 * MAX_TERMS)),
        ("field_axis", Integer * MAX_SLOTS), ("term", Real * MAX_TERMS),
        ("field_lower", Real * MAX_JOINTS), ("field_upper", Real * MAX_JOINTS),
        ("field_base", Real * 9), ("field_turn", Real), ("field_waves", Integer),
        ("form", KernelForm),
        *((f"library_{name}", Pointer) for name in ("q", "slots", "columns")),
    ]  # fmt: skip


class KernelSolution(ctypes.Structure):
    """`Solution`: a command, the state that it leads to, and how the joints arrive."""

    _fields_ = [
        ("q", Real * MAX_JOINTS), ("slots", Real * MAX_SLOTS), ("tau", Real * MAX_SLOTS), ("excess", Real),
        ("slope", Real), ("side", Integer * MAX_JOINTS), ("detour", Integer * MAX_JOINTS), ("free", Integer),
    ]  # fmt: skip


class KernelFound(ctypes.Structure):
    """`Found`: solutions of one goal."""

    _fields_ = [("count", Integer), ("steps", Integer), ("at", KernelSolution * MAX_FOUND)]


def fits(name: str, count: int, most: int) -> None:
    """Raises `LrmError` if there are more than the kernel has room for."""
    if count > most:
        raise LrmError(f"the model has {count} {name}; the kernel of inverse kinematics has room for {most}")


SOURCE = Path(__file__).with_name("ik_kernel.c")
BUILT = SOURCE.with_name({"win32": "ik_kernel.dll", "darwin": "ik_kernel.dylib"}.get(sys.platform, "ik_kernel.so"))
REBUILD = "run `make setup` (or `pip install -e .`) in the checkout, or install the package again"
ARGUMENTS: dict[str, list[type]] = {
    "ik_pose": [Pointer] * 4,
    "ik_free": [Pointer, Pointer, Integer, Pointer, Pointer, Integer, Pointer],
    "ik_nearest": [Pointer, Pointer, Integer, Integer, Integer, Integer, Pointer, Pointer],
    "ik_forward": [Pointer, Integer, Pointer, Pointer, Pointer, Pointer],
    "ik_load_derivatives": [Pointer] * 3,
    "ik_settle": [Pointer, Integer, Pointer, Pointer, Real, Pointer, Pointer, Pointer],
    "ik_newton": [Pointer, Pointer, Integer, Pointer, Pointer, Pointer, Pointer],
    "ik_hold": [Pointer] * 5,
    "ik_nominal": [Pointer, Integer, Pointer, Pointer, Integer, Pointer, Pointer, Pointer],
    "ik_cube": [Pointer, Pointer, Pointer, Real, Integer, Pointer, Real, Pointer, Pointer],
}


@cache
def kernel() -> ctypes.CDLL:
    """The kernel's functions. Raises `LrmError` as `loaded`."""
    return loaded(BUILT)


def loaded(path: Path) -> ctypes.CDLL:
    """The functions of a compiled kernel.

    Raises `LrmError`: it was not built, not for this machine, or from another source than the one beside it.
    """
    if not path.exists():
        raise LrmError(f"{path}: the compiled kernel of inverse kinematics is missing; {REBUILD}")
    try:
        library = ctypes.CDLL(str(path))
        library.ik_source.restype, library.ik_size.restype = ctypes.c_uint, ctypes.c_size_t
        built, sizes = library.ik_source(), (library.ik_size(0), library.ik_size(1))
    except (OSError, AttributeError) as error:
        raise LrmError(f"{path}: no kernel for this machine ({error}); {REBUILD}") from None
    stale = SOURCE.exists() and built != zlib.crc32(SOURCE.read_bytes())
    if stale or sizes != (ctypes.sizeof(KernelArm), ctypes.sizeof(KernelFound)):
        raise LrmError(f"{path}: built from another version of {SOURCE.name}; {REBUILD}")
    for name, arguments in ARGUMENTS.items():
        getattr(library, name).argtypes = arguments
    return library
