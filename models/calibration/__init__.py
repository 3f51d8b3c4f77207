"""The calibration: it makes a sensor model from recordings of strips. No estimator imports this package."""
