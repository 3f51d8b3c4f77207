"""The shapes of a whole trial as one value."""

from dataclasses import fields, replace

import numpy as np
import pytest

from tensegraph import InputError, Reconstruction, Settings, three_strut
from tensegraph.estimator.frame import FrameEstimator
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.models.structure.floor import EstimatedNormal
from tensegraph.models.structure.lengths import length_jacobian
from tensegraph.models.structure.shape import OtherShape, Reason
from tensegraph.models.values.readings import SensorDrift
from tensegraph.models.values.slip import Slip


class TestReconstruction:
    def test_innovations(self, structure, rest, lengths_of) -> None:
        frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(4)]
        frames[-1].length_m[7] = np.nan
        frames[-1].sigma_m[7] = np.inf
        result = Reconstruction.of(structure, LiveSmoother(structure, rest, Settings()).estimate(frames))
        np.testing.assert_allclose(result.predicted_m, structure.tendon_length_m(result.node_position_m))
        tested = np.isfinite(result.innovation_sigma_m[0])
        assert tested.tolist() == (~structure.is_free_tendon).tolist()  # lengths alone: none is tested by others
        assert (result.innovation_sigma_m[0, tested] < 0.0005).all()
        jacobian = length_jacobian(result.node_position_m[-1], structure.tendons).reshape(24, -1)
        expected = np.sqrt(jacobian[7] @ result.covariance_m2[-1] @ jacobian[7])
        assert result.innovation_sigma_m[-1, 7] == pytest.approx(expected)

    def test_shapes_of_another_structure_are_refused(self, structure, rest, lengths_of) -> None:
        shapes = LiveSmoother(structure, rest, Settings()).estimate([lengths_of(structure, rest.node_position_m, 0.0)])
        with pytest.raises(InputError, match="with 6 nodes and 9 tendons, got one with 12 and 24"):
            Reconstruction.of(three_strut(0.3, 0.2), shapes)

    def test_mechanism_is_seen(self, structure, rest, lengths_of) -> None:
        frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(3)]
        result = Reconstruction.of(structure, FrameEstimator(structure, rest, Settings()).estimate(frames))
        assert (result.smallest_singular_value < 1e-3).all()
        assert (result.mechanism_sigma_m > 0.01).all()  # to second order lengths tell a motion of 17 mm

    def test_iterates_as_shapes(self, structure, rest, lengths_of) -> None:
        frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(3)]
        result = Reconstruction.of(structure, FrameEstimator(structure, rest, Settings()).estimate(frames))
        again = Reconstruction.of(structure, iter(result))
        np.testing.assert_array_equal(again.covariance_m2, result.covariance_m2)
        assert len(again) == 3

    def test_a_shape_holds_what_the_run_holds_of_it(self, structure, rest, lengths_of) -> None:
        """All fields but what a run keeps once for all frames, or only counts."""
        frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(2)]
        shapes = list(FrameEstimator(structure, rest, Settings()).estimate(frames))
        told = [
            replace(
                shape,
                doubt=Reason.GEOMETRY,
                contacts=np.linspace(0, 1, 12),
                slips=(Slip(0.02, 1, np.array([0.01, 0.0, 0.0]), 0.002),),
                floor_normal=EstimatedNormal((0.0, 0.0, 1.0), 0.01),
                contradicted_positions=(3,),
                other=OtherShape(shape.node_position_m, 0.1),
            )
            for shape in shapes
        ]
        shape = Reconstruction.of(structure, told)[0.02]
        np.testing.assert_allclose(shape.covariance_m2, told[1].covariance_m2, atol=1e-15)  # it holds one triangle
        counted = {"covariance_m2", "lengths", "factor_innovation", "outlying_ranges"}
        for name in {each.name for each in fields(shape)} - counted:
            np.testing.assert_equal(getattr(shape, name), getattr(told[1], name), err_msg=name)

    def test_drift_is_that_of_the_frames_which_show_it(self, structure, rest, lengths_of) -> None:
        """By nothing, by the lengths together, and by reference tendons."""
        frames = [lengths_of(structure, rest.node_position_m, 0.02 * k) for k in range(3)]
        shapes = list(FrameEstimator(structure, rest, Settings()).estimate(frames))
        plain = SensorDrift(np.full(24, 0.01), np.full(24, 0.002), np.full(24, 0.2))
        drifts = [plain, replace(plain, covariance_m2=1e-8 * np.eye(24)), replace(plain, references=3)]
        told = [
            replace(shape, lengths=replace(shape.lengths, drift=drift))
            for shape, drift in zip(shapes, drifts, strict=True)
        ]
        result = Reconstruction.of(structure, told)
        assert np.isnan(result.drift[0]).all()
        assert np.isnan(result.drift_sigma[0]).all()
        assert (result.drift[1:] == 0.01).all()
        assert Reconstruction.of(structure, told[:1]).drift is None

    def test_blocks_of_frames_are_as_the_whole(self, structure, rest, lengths_of, monkeypatch) -> None:
        frames = [lengths_of(structure, rest.node_position_m, 0.02 * k, noise=0.001 * k) for k in range(5)]
        shapes = list(FrameEstimator(structure, rest, Settings()).estimate(frames))
        whole = Reconstruction.of(structure, shapes)
        names = ("innovation_sigma_m", "smallest_singular_value", "mechanism_sigma_m", "branch")
        expected = {name: getattr(whole, name) for name in names}
        monkeypatch.setattr("tensegraph.models.structure.reconstruction.BLOCK_FRAMES", 2)
        in_blocks = Reconstruction.of(structure, shapes)
        for name in names:
            np.testing.assert_array_equal(getattr(in_blocks, name), expected[name])
