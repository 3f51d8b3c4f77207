"""Plain values that every other room may use: errors, checked tables, readings, the state of the link."""
