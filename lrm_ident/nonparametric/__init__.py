"""Models without physics: what could be predicted of a residual, and where it is concentrated."""
