"""Verification: goals of the tip, commands for them by a model, and where the tip lands."""
