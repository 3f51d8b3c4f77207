"""Files of motion capture, read as they come from the capture's program."""
