"""Runnable examples of the whole system."""
