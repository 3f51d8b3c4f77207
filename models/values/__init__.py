"""Plain values that every other room may use: errors, checked tables, readings, stamped positions, the serial link."""
