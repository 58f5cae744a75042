"""The workbench in a real browser: pictures of the tutorial, of README and of the site."""
