"""Benefit and harm of a residual field."""
