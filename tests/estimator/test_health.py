"""Sensors that drift."""

from dataclasses import replace

import numpy as np
import pytest

from balance import K, nominal
from tensegraph import Settings, Status
from tensegraph.estimator.rest.rest_step import rest_step
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.models.structure.rest_shape import GeometrySigma
from tensegraph.models.values.readings import Flag


class TestHealth:
    def test_a_drifting_sensor_is_named_left_out_and_taken_back(self, structure, balanced, lengths_of) -> None:
        """One sensor of 24 drifts by 2 mm/s for 3 s, then is right again."""
        rng, frames = np.random.default_rng(6), []
        for k in range(400):
            drift = np.zeros(24)
            drift[14] = 0.002 * np.clip(0.02 * k - 1, 0, 3) * (k < 200)
            noise = drift + 2e-4 * rng.standard_normal(24)
            frames.append(lengths_of(structure, balanced.node_position_m, 0.02 * k, 5e-4, noise))
        shapes = list(LiveSmoother(structure, balanced, Settings()).estimate(frames))
        named = np.array([shape.lengths.flags & Flag.IMPLAUSIBLE > 0 for shape in shapes])
        assert not np.delete(named, 14, axis=1).any()
        first = 0.02 * np.argmax(named[:, 14])
        assert 1 < first < 1 + 0.75 + 2  # three sigma are reached after 0.75 s
        assert named[170:200, 14].all()
        assert not named[-50:, 14].any()
        error = np.array([shape.node_position_m for shape in shapes]) - balanced.node_position_m
        assert np.sqrt((error[120:200] ** 2).sum(-1)).max() < 0.004
        assert shapes[180].status == Status.PARTIAL

    @pytest.mark.parametrize("times_as_stiff", [1 / 16, 1, 64])
    def test_a_drifting_sensor_at_an_anchor_is_no_load(self, times_as_stiff, structure, lengths_of) -> None:
        """Tendon 5, from anchor 1 to node 3, whose rod stands on an anchor: one load at node 3 explains it as well."""
        assert structure.tendons[5].tolist() == [1, 3]
        stiffness = np.full(24, times_as_stiff * K)
        mechanics = replace(nominal(structure, times_as_stiff * 0.03), stiffness_n_per_m=stiffness)
        settings = Settings().for_robot(structure, mechanics)
        balanced = rest_step(structure, mechanics, None, GeometrySigma(), settings.rest)
        rng, frames = np.random.default_rng(6), []
        for k in range(350):
            noise = 2e-4 * rng.standard_normal(24)
            noise[5] -= 0.001 * np.clip(0.02 * k - 1, 0, 5)
            frames.append(lengths_of(structure, balanced.node_position_m, 0.02 * k, 5e-4, noise))
        shapes = list(LiveSmoother(structure, balanced, settings).estimate(frames))
        named = np.array([shape.lengths.flags & Flag.IMPLAUSIBLE > 0 for shape in shapes])
        assert not np.delete(named, 5, axis=1).any()
        assert 1 < 0.02 * np.argmax(named[:, 5]) < 4.5
        error_m = shapes[-1].node_position_m - balanced.node_position_m
        assert np.linalg.norm(error_m, axis=1).max() < 0.003
