"""All frames of a trial as stacked arrays: their factors, and the shapes of least error."""
