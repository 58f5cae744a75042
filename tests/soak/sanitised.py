"""The IK fuzz with the kernel under AddressSanitizer and UndefinedBehaviorSanitizer: `sanitised [QUERIES] [SEED]`.

Compiles the kernel with GCC's or Clang's sanitizers into a temporary folder and runs `tests.soak.fuzz_ik` with it in a
process of its own, in which the sanitizers' runtime comes first. The first invalid access ends that process.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

from lrm_math.ik.kernel import shared_library
from tests.soak import fuzz_ik

FLAGS = ("-std=c99", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fPIC", "-shared")
RUNTIMES = ("libasan.so", "libubsan.so")
HERE = "LRM_SANITISED_KERNEL"


def runtimes() -> list[str]:
    """Files of the sanitizers' runtime; empty where the machine has none."""
    try:
        asked = [["cc", f"-print-file-name={name}"] for name in RUNTIMES]
        found = [subprocess.run(c, capture_output=True, text=True, check=True).stdout.strip() for c in asked]
    except (OSError, subprocess.CalledProcessError):
        return []
    return found if all(Path(name).is_absolute() and Path(name).exists() for name in found) else []


def run(queries: int, seed: int, capture: bool = False) -> subprocess.CompletedProcess[str]:
    """The fuzz in a process with the sanitised kernel. Its exit code is 0 if nothing was found."""
    with tempfile.TemporaryDirectory() as folder:
        built = Path(folder, shared_library.BUILT.name)
        crc = f"-DSOURCE_CRC={zlib.crc32(shared_library.SOURCE.read_bytes())}u"
        subprocess.run(["cc", *FLAGS, crc, str(shared_library.SOURCE), "-o", str(built), "-lm"], check=True)
        environment = os.environ | {
            HERE: str(built), "LD_PRELOAD": " ".join(runtimes()), "ASAN_OPTIONS": "detect_leaks=0",
            "UBSAN_OPTIONS": "print_stacktrace=1", "OPENBLAS_NUM_THREADS": "1",
        }  # fmt: skip
        command = [sys.executable, "-m", "tests.soak.sanitised", str(queries), str(seed)]
        return subprocess.run(command, env=environment, capture_output=capture, text=True)


def main() -> int:
    """Exit code of the fuzz."""
    queries, seed = (int(word) for word in (*sys.argv[1:3], *("1000", "0")[len(sys.argv) - 1 :]))
    if built := os.environ.get(HERE):
        shared_library.BUILT = Path(built)
        return fuzz_ik.main(queries, seed)
    if not runtimes():
        print("error: this machine's C compiler has no sanitizers", file=sys.stderr)
        return 2
    return run(queries, seed).returncode


if __name__ == "__main__":
    sys.exit(main())
