"""The arm in motion: moves of a recording, the model on them, what it misses."""
