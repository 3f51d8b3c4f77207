"""Settings that differ in their noise alone."""

from dataclasses import replace

from tensegraph import Settings
from tensegraph.models.estimation import NoiseSettings


def with_noise(**changes) -> Settings:
    return replace(Settings(), noise=replace(NoiseSettings(), **changes))
