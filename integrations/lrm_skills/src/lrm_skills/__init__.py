"""The daemon's skills as states of a state machine: behaviours of py_trees, and a library of RAFCON."""
