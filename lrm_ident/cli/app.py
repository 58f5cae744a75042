"""`lrm-ident` with every command."""

from __future__ import annotations

# Commands stand in the help in the order in which their modules are loaded.
from lrm_ident.cli import identifiability, design, fit, component_tests, workspace, diagnosis, laws  # isort: skip
from lrm_ident.cli.groups import fleet  # isort: skip
from lrm_ident.cli.page import report, workbench  # isort: skip
from lrm_ident.cli import campaign  # isort: skip
from lrm_ident.cli.groups import arm, camera, checkup  # isort: skip
from lrm_ident.cli.application import app, main

__all__ = [
    "app",
    "arm",
    "camera",
    "campaign",
    "checkup",
    "component_tests",
    "design",
    "diagnosis",
    "fit",
    "fleet",
    "identifiability",
    "laws",
    "main",
    "report",
    "workbench",
    "workspace",
]
