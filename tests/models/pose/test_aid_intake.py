"""Readings of other sensors on their way to the frames, and what is told of them."""

from dataclasses import replace

import numpy as np

from tensegraph.models.pose.aid_intake import AidIntake
from tensegraph.models.structure.shape import Shape, Status
from tensegraph.models.values.aids import ImuReading


def test_all_that_looks_wrong_of_a_sensor_is_told(rest, structure, lengths_of) -> None:
    """It measures 20 times a second, an hour later than the frames: one does not hide the other."""
    intake = AidIntake(rest, 1.0, 5e-4, imus=1, ranges=0, positions=(), own_frames=())
    for k in range(120):
        intake.take(ImuReading(0, 3600 + 0.05 * k, np.full(3, 1e-4 * k), np.array([0.0, 0.0, 9.8 + 1e-4 * k])))
    lengths = lengths_of(structure, rest.node_position_m)
    for t_s in (0.0, 1.0, 2.0):
        given = intake.given_to(replace(lengths, t_s=t_s))
        intake.use.observe(Shape(t_s, rest.node_position_m, 1e-6 * np.eye(36), Status.OK, given))
    text = intake.warnings()["imu 0"]
    assert "is t_s of the same clock?" in text
    assert "a new sample each 0.05 s" in text
