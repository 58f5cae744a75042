"""Interactive figures, the same in the workbench and in the report: values from Python, drawing in `figures.js`."""
