"""Version of the tool, as model files and `--version` name it."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def tool_version() -> str:
    """`lrm-ident` and its version."""
    try:
        return f"lrm-ident {version('lrm-arm')}"
    except PackageNotFoundError:
        return "lrm-ident (not installed)"
