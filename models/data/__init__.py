"""The sensor model that ships with the package, see `tensegraph.models.sensor.sensor_model`."""
