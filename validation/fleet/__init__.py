"""Many simulated arms of one kind: the prior of a fleet on its next arm."""
