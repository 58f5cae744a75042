"""The fourth part of the second catalogue: causes that nothing was set by, for a test of what `auto` claims."""
