"""What was measured of poses, one kind in each file: read, predicted, weighed."""
