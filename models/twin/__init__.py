"""The digital twin: a plan in, what the boards would send and what was true out."""
