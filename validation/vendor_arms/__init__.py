"""Real arms as their vendors describe them: how many are imported, and whether they move as in MuJoCo."""
