"""From lengths with sigma to shapes with covariance: one frame, live, batch. Knows no file, no port, no screen."""
