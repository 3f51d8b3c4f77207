"""Lengths from files that are no CSV: bags of ROS 2, read without ROS, and what readers of other packages read."""
