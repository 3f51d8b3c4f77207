"""The pose of a free-standing structure, and the sensors that it carries beside its tendons."""
