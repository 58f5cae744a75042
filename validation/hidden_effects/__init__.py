"""Inject and recover: arms with hidden effects from the independent generator, and what lrm-ident names."""
