"""Residual field: its regression, and the step that adds it to a fitted model."""
