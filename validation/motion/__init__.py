"""Hidden effects of motion: an independent generator of recordings, and what the tool answers to them."""
