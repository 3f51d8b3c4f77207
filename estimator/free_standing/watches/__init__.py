"""What inertial sensors feel against the floor that holds the pose: feet that slide, a rise, a stand on no face."""
