"""The picture of a residual: an arrow at every measured position, and the arm that was there."""
