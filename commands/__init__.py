"""What each command does, one module a verb; their options are in `cli`."""
