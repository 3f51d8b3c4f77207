"""The factors: one physical law in each file, as gtsam factors over the nodes of a frame or rows over a pose."""
