"""Measurement files: read, checked, written."""
