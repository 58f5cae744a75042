"""Puts a load on the simulated tool: `python -m examples.demo.load BOARD GRAMS`, in place of a person's hand."""

from __future__ import annotations

import sys
from pathlib import Path

from lrmd.sim.control_socket import query_board

if __name__ == "__main__":
    query_board(Path(sys.argv[1]), f"payload {sys.argv[2]}")
