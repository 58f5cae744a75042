"""The report in one HTML file, and the workbench: a local page on which a model is compared, diagnosed and extended."""
