"""The long work of the workbench, in a process of its own; what goes there and what comes back."""
