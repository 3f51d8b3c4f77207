"""Pipelines as nobody has set anything: with the default settings, and the sensor model that ships with the package."""

from tensegraph import Settings
from tensegraph.io.model_file import read_sensor_model
from tensegraph.models.trial_description import TrialDescription
from tensegraph.pipeline import Pipeline


def pipeline_of(trial: TrialDescription) -> Pipeline:
    """Return the pipeline of a trial."""
    return Pipeline(trial, Settings(), read_sensor_model())
