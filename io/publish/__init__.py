"""Shapes of a live session for other programs: as JSON by UDP, and as messages of ROS 2."""
