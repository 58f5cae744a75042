"""Groups of commands, `lrm-ident GROUP COMMAND`, and `transfer`."""
