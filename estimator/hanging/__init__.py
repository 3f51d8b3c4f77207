"""Shape and pose of a structure that hangs from one anchor or two."""
