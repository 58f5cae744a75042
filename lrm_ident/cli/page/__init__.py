"""Commands that show what the others compute."""
