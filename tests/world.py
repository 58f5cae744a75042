"""The tests' name of `bench.world`, which the soak runs as well."""

from bench.world import CONFIG, CYCLE, World, config_at

__all__ = ["CONFIG", "CYCLE", "World", "config_at"]
