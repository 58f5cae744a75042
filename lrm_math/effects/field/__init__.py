"""Predictions that name no cause."""
