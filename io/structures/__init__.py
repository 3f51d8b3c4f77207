"""Structures from files of other programs, and into them."""
