"""The names at the top of lrm_math: all there, and none imported before it is used."""

from __future__ import annotations

import subprocess
import sys

import lrm_math


def test_every_name_at_the_top_is_there() -> None:
    assert all(getattr(lrm_math, name).__module__.startswith("lrm_math") for name in lrm_math.__all__ if name[0] != "C")
    assert set(lrm_math.__all__) == {name for names in lrm_math._NAMES.values() for name in names}


def test_the_package_alone_imports_no_numpy() -> None:
    """The ramp imports modules of it that need none."""
    code = "import sys, lrm_math; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
