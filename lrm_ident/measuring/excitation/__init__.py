"""Moves that tell effects of motion apart: what may be driven, which of it is chosen, and its file."""
