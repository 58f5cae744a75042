"""The offline tool: identify the model from measured TCP positions, see where it fails."""
