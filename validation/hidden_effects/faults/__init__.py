"""The third catalogue: what goes wrong in a measurement, for most of which the tool has no formula."""
