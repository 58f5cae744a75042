"""What predicts without naming a cause."""
