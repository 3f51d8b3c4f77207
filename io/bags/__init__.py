"""Measurements from bags of ROS 2, read without ROS."""
