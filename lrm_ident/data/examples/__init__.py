"""The shipped data sets."""

from __future__ import annotations

from pathlib import Path

EXAMPLE = Path(__file__).with_name("hidden-play.csv")
"""The shipped data set: 300 synthetic poses of the arm `lrm-lab` with 2.3 degrees of play hidden in joint 2."""
