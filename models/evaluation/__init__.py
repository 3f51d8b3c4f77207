"""The comparison of an estimate with the truth. No estimator imports this package."""
