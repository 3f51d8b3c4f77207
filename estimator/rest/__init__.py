"""The rest step: the rest shape, and what of the geometry was told wrongly, before the first frame."""
