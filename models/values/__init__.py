"""Plain values that every other package may use: errors, checked tables, readings, the state of the serial link."""
