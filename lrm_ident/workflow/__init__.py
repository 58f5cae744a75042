"""What the command line and the workbench do alike: read and check files, take a step, gather what is known."""
