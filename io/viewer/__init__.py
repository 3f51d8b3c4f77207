"""Runs in the viewer Rerun: in space and over time, with the first screen, and the server of its page."""
