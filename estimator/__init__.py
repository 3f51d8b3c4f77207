"""The estimators: from lengths with sigma to shapes with covariance. They use no files, serial ports or screens."""
