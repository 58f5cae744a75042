"""Measuring with the arm: the only room of the offline tool that talks to the daemon, through `lrmd.client`."""
