"""Shape, pose and contacts of a structure that stands free on a floor."""
