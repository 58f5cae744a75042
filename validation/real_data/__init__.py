"""Public measurements of real arms (docs/public-data.md): fetched, never kept in the project."""
