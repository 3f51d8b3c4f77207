"""What may have changed since the sensors were tared: a rod, the natural length of a tendon, the sensors of a board."""
