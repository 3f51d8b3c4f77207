"""Recordings of strips in, models with their card and figures out."""
