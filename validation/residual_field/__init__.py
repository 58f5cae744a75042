"""What a residual field is worth, and what it must not do."""
