"""Methods to compare with: the paper's, an unscented Kalman filter, and a network alone."""
