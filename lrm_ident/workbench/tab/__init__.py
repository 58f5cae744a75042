"""Elements of one browser tab of the workbench."""
