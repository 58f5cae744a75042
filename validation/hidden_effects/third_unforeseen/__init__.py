"""The fifth part of the second catalogue: fresh causes for a second test of what `auto` claims."""
