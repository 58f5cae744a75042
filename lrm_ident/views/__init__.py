"""What the interactive figures show, as plain values: error field, turns of the joints, candidates."""
