"""What one browser tab of the workbench shows."""
