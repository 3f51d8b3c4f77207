"""Scores of loads, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from four_nodes import TRUE_M, estimate_of, four_nodes, moved, truth_of
from tensegraph.models.evaluation.load_score import score_loads
from tensegraph.models.evaluation.metrics import evaluate
from tensegraph.models.evaluation.truth import TrueLoads
from tensegraph.models.structure.external_loads import ExternalLoads


class TestLoads:
    def scored(self, result):
        """Two nodes in four frames, along x, in newtons.

        True 1 0 | 0.25 0 | 0 0.1 | 0.5 0.4; estimated 0.7 0 | 0.1 0.3 | 0 0.3 | 0.2 0.6. Truly loaded are (1, 0.25,
        0.5, 0.4), of which 0.7 and 0.6 are called so (0.2 is not above 0.2); so are 0.3 and 0.3 of the four unloaded.
        """
        true, estimated = np.zeros((4, 2, 3)), np.zeros((4, 2, 3))
        true[..., 0] = [[1, 0], [0.25, 0], [0, 0.1], [0.5, 0.4]]
        estimated[..., 0] = [[0.7, 0], [0.1, 0.3], [0, 0.3], [0.2, 0.6]]
        return score_loads(replace(result.compared, true_load_n=true, estimated_load_n=estimated), 0.2)

    def test_a_score_by_hand(self, result) -> None:
        score = self.scored(result)
        assert score.loaded_rmse_n == pytest.approx(np.sqrt((0.3**2 + 0.15**2 + 0.3**2 + 0.2**2) / 4))
        assert score.unloaded_rmse_n == pytest.approx(np.sqrt((0 + 0.3**2 + 0 + 0.2**2) / 4))
        assert (score.recall, score.precision, score.false_alarm_share) == (2 / 4, 2 / 4, 2 / 4)
        assert score.quiet_false_alarm_share == 1 / 2  # the third frame: 0 and 0.3
        assert (score.clear_frames, score.most_loaded_share) == (2, 1 / 2)  # 1 N at the first: right; 0.5 N: not

    def test_a_frame_with_one_loaded_node_is_not_quiet_at_the_others(self, result) -> None:
        """True 0.5 0 | 0 0, estimated 0.5 0.3 | 0 0: the false detection is beside a load, and none is while quiet."""
        true, estimated = np.zeros((2, 2, 3)), np.zeros((2, 2, 3))
        true[0, :, 0], estimated[0, :, 0] = [0.5, 0], [0.5, 0.3]
        score = score_loads(replace(result.compared, true_load_n=true, estimated_load_n=estimated), 0.2)
        assert (score.false_alarm_share, score.quiet_false_alarm_share) == (1 / 3, 0)

    def test_without_loads_on_either_side_there_is_none(self, result) -> None:
        assert result.loads is None
        assert score_loads(replace(result.compared, true_load_n=np.zeros((3, 1, 3))), 0.2) is None

    def test_nothing_loaded_nothing_found(self, result) -> None:
        nothing = np.zeros((3, 1, 3))
        score = score_loads(replace(result.compared, true_load_n=nothing, estimated_load_n=nothing), 0.2)
        assert np.isnan([score.loaded_rmse_n, score.recall, score.precision, score.most_loaded_share]).all()
        assert (score.unloaded_rmse_n, score.false_alarm_share, score.clear_frames) == (0, 0, 0)

    def test_evaluate_compares_them_along_the_true_rod_at_the_frames(self) -> None:
        """True 0 at 0 s and (6, 0, 0) at 0.04 s: at 0.02 s (3, 0, 0), of which (2.5, -0.5, -1) is observable."""
        structure = four_nodes()
        force = np.full((3, 4, 3), np.nan)
        force[:, 3] = [2.5, -0.5, 0]
        loads = ExternalLoads(force, np.full((3, 4), 0.1))
        true_n = np.zeros((2, 4, 3))
        true_n[1, 3] = [6, 0, 0]
        estimate = replace(estimate_of(structure, moved([[0, 0, 0]] * 3)), loads=loads)
        truth = truth_of(3, loads=TrueLoads(np.array([0.0, 0.04]), true_n))
        compared = evaluate(TRUE_M, estimate, truth).compared
        np.testing.assert_allclose(compared.true_load_n[:, 0], [[0, 0, 0], [2.5, -0.5, -1], [5, -1, -2]], atol=1e-12)
        np.testing.assert_allclose(compared.estimated_load_n[1, 0] - compared.true_load_n[1, 0], [0, 0, 1], atol=1e-12)
