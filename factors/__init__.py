"""One physical law a file, each as native gtsam factors over the nodes of a frame."""
