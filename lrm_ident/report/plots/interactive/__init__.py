"""Interactive figures, the same in the workbench and in the report: values from Python, drawn by `page/figures.js`."""
