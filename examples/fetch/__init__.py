"""A stone at a measured place into the basket, on a simulated rover with hidden errors: `python -m examples.fetch`."""
