"""Symbolic regression of a law: an exhaustive small grammar over the quantities that a joint's error may follow."""
