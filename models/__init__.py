"""The models: the structure, its shapes and loads, the sensors, and their calibration. No files, no gtsam."""
