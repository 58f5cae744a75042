"""Weights of what was measured."""
