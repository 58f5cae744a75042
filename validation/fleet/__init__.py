"""Many simulated arms of one kind: what a fleet tells of its next arm."""
