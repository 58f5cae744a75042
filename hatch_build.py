"""Builds the compiled kernel of inverse kinematics into the package: for wheels, and for editable installs in place.

With the machine's compiler, or, where there is none, with the package `ziglang`, which pip then fetches for the build.
`LRM_WHEEL_TARGET`, one of `TARGETS`, builds a wheel for another machine, always with ziglang. `LRM_WITHOUT_KERNEL=1`
leaves the kernel out: the wheel is for any machine then, and runs the offline tool alone.
"""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import zlib
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

KERNEL = Path("lrm_math", "ik", "kernel")
NAMES = {"win": "ik_kernel.dll", "macos": "ik_kernel.dylib", "linux": "ik_kernel.so"}
TARGETS = {
    "manylinux_2_17_x86_64": "x86_64-linux-gnu.2.17",
    "manylinux_2_17_aarch64": "aarch64-linux-gnu.2.17",
    "macosx_11_0_x86_64": "x86_64-macos.11.0",
    "macosx_11_0_arm64": "aarch64-macos.11.0",
    "win_amd64": "x86_64-windows-gnu",
    "win_arm64": "aarch64-windows-gnu",
}
"""Platform tag of a wheel, and ziglang's name of the machine."""
FLAGS = ["-std=c99", "-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off", "-fvisibility=hidden", "-s"]
ZIGLANG = "ziglang>=0.13"
FAILED = "the compiled kernel of inverse kinematics could not be built"
WITHOUT = (
    "Install a C compiler (cc, gcc, clang, or the Python package ziglang). For the offline tool alone, which fits, "
    "diagnoses and reports without the kernel: LRM_WITHOUT_KERNEL=1 pip install ..."
)


def target() -> str:
    """The platform tag asked for, or empty for this machine. Raises `SystemExit` for an unknown one."""
    asked = os.environ.get("LRM_WHEEL_TARGET", "")
    if asked and asked not in TARGETS:
        raise SystemExit(f"LRM_WHEEL_TARGET = {asked}; should be one of {', '.join(TARGETS)}")
    return asked


def unwanted() -> bool:
    """Whether the kernel is to be left out: the offline tool fits and diagnoses without it."""
    return os.environ.get("LRM_WITHOUT_KERNEL", "") == "1"


def machine_compiler() -> list[str] | None:
    """The command of this machine's C compiler, `CC` first; None if there is none."""
    commands = [shlex.split(os.environ.get("CC", "")), ["cc"], ["gcc"], ["clang"]]
    return next((command for command in commands if command and shutil.which(command[0])), None)


def ziglang_compiler() -> list[str]:
    """The command of ziglang's. Raises `SystemExit` where it is not installed."""
    if importlib.util.find_spec("ziglang") is None:
        raise SystemExit("no C compiler was found: install one (cc, gcc or clang), or the Python package ziglang")
    return [sys.executable, "-m", "ziglang", "cc"]


def build(folder: Path) -> tuple[Path, str]:
    """Compiles the kernel beside its source: the file, and the wheel's platform tag. Raises `SystemExit`."""
    source, asked = folder / KERNEL / "ik_kernel.c", target()
    platform = asked or sysconfig.get_platform().replace("-", "_").replace(".", "_")
    system = next((name for name in NAMES if platform.startswith(name)), "linux")
    out = source.with_name(NAMES[system]) if not asked else folder / "build" / asked / NAMES[system]
    out.parent.mkdir(parents=True, exist_ok=True)
    compiler = [*ziglang_compiler(), "-target", TARGETS[asked]] if asked else machine_compiler() or ziglang_compiler()
    flags = [*FLAGS, f"-DSOURCE_CRC={zlib.crc32(source.read_bytes())}u", *([] if system == "win" else ["-fPIC"])]
    half_made = out.with_suffix(".part")
    command = [*compiler, *flags, "-shared", str(source), "-o", str(half_made), *([] if system == "win" else ["-lm"])]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{FAILED}:\n{' '.join(command)}\n{done.stderr}\n{WITHOUT}")
    half_made.replace(out)
    return out, platform


class CustomBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Hatchling's hook of that name."""

    def dependencies(self) -> list[str]:
        """Requirements of the build beside hatchling."""
        needed = self.target_name == "wheel" and (target() or (machine_compiler() is None and not unwanted()))
        return [ZIGLANG] if needed else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Builds the kernel; a wheel is for one platform and any Python 3."""
        if self.target_name != "wheel":
            return
        if unwanted():
            self.app.display_warning("LRM_WITHOUT_KERNEL: no compiled kernel, so no daemon, no inverse kinematics")
            return
        library, platform = build(Path(self.root))
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{platform}"
        if version != "editable":
            build_data["force_include"][str(library)] = str(KERNEL / library.name)


if __name__ == "__main__":
    print(build(Path(__file__).resolve().parent)[0])
