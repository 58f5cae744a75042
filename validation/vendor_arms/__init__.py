"""Descriptions of real arms as their vendors publish them: how many are imported, and whether they move as in MuJoCo."""
