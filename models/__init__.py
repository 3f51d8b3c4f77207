"""Nouns and sensor equations: what a tensegrity is, what a reading is, what a shape is. Imports numpy only."""
