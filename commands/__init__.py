"""The work of the commands, one module for each; their options are in `cli`."""
