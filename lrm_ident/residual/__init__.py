"""The residual of a model: what it follows, what of it could still be predicted, and where it is largest."""
