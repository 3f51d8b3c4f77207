"""Whether what is told of a trial is so while it lasts: that its lengths are read, and that its base stands still."""
