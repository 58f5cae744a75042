"""The compiled kernel, found beside its source, checked and loaded once.

It is built by `hatch_build.py` at the root of the project when the package is installed or a wheel is made.
"""

from __future__ import annotations

import ctypes
import sys
import zlib
from functools import cache
from pathlib import Path

from lrm_math.errors import LrmError
from lrm_math.ik.kernel.structures import Integer, KernelArm, KernelFound, Pointer, Real

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
