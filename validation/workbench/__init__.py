"""The workbench in a real browser: pictures of the tutorial, and how fast it is."""
