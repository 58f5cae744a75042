"""Names of effects and parameters for people: symbols, and plain words."""
