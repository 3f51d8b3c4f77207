"""When a fault is seen, and what is seen without one."""

from dataclasses import replace

import numpy as np
import pytest

from four_nodes import TRUE_M, estimate_of, four_nodes
from tensegraph import Flag, Reconstruction
from tensegraph.models.evaluation.fault_score import false_alarm_share, score_fault
from tensegraph.models.evaluation.truth import Fault


class TestFaults:
    FAULT = Fault("stuck", "tendon 2", np.array([2]), 0.05, 0.13)

    def estimate(self, flags) -> Reconstruction:
        return estimate_of(four_nodes(), np.repeat(TRUE_M[None], 10, axis=0), flags=np.asarray(flags))

    def flags(self, *cells) -> np.ndarray:
        table = np.zeros((10, 4), dtype=np.int64)
        for frame, tendon, flag in cells:
            table[frame, tendon] = flag
        return table

    def test_delay(self) -> None:
        """Frames every 0.02 s: the first in the interval is 3, at 0.06 s."""
        estimate = self.estimate(self.flags((1, 2, Flag.STUCK), (5, 2, Flag.STUCK), (6, 2, Flag.STUCK)))
        score = score_fault(self.FAULT, estimate)
        assert (score.tendons, score.named) == (1, 1)
        assert score.delay_s == pytest.approx(0.05)

    def test_not_seen(self) -> None:
        estimate = self.estimate(self.flags((1, 2, Flag.STUCK), (5, 1, Flag.STUCK), (5, 2, Flag.TOO_FAST)))
        score = score_fault(self.FAULT, estimate)
        assert (score.named, score.delay_s) == (0, None)

    def test_a_length_left_out_names_its_sensor(self) -> None:
        estimate = self.estimate(self.flags())
        estimate.sigma_m[4, 2] = np.inf
        assert score_fault(self.FAULT, estimate).delay_s == pytest.approx(0.03)

    def test_a_board_is_seen_when_its_last_tendon_is(self) -> None:
        fault = replace(self.FAULT, where="board 0", tendons=np.array([0, 2]))
        one = self.flags((3, 0, Flag.MISSING))
        both = one | self.flags((6, 2, Flag.MISSING))
        assert score_fault(fault, self.estimate(one)).delay_s is None
        assert score_fault(fault, self.estimate(one)).named == 1
        assert score_fault(fault, self.estimate(both)).delay_s == pytest.approx(0.07)

    def test_false_alarms(self) -> None:
        """Of 10 x 4 readings 4 are in the fault; of the 36 others 2 are named, one only warms up."""
        flags = self.flags((4, 2, Flag.STUCK), (4, 1, Flag.OUTLIER), (8, 2, Flag.STUCK), (0, 0, Flag.WARMING_UP))
        assert false_alarm_share([self.FAULT], self.estimate(flags)) == pytest.approx(2 / 36)

    def test_a_cell_that_is_blank_is_no_reading(self) -> None:
        """Ten cells of tendon 1 are blank; of the 30 readings one is named."""
        flags = self.flags(*((frame, 1, Flag.MISSING) for frame in range(10)), (4, 0, Flag.OUTLIER | Flag.MISSING))
        assert false_alarm_share([], self.estimate(flags)) == pytest.approx(1 / 30)

    def test_a_tendon_without_a_sensor_gives_no_alarm(self) -> None:
        """Tendon 2 has none, and so no reading; of the 10 x 3 readings one is named."""
        structure = replace(four_nodes(), unsensed=[2])
        flags = self.flags(*((frame, 2, Flag.MISSING) for frame in range(10)), (4, 1, Flag.OUTLIER))
        estimate = estimate_of(structure, np.repeat(TRUE_M[None], 10, axis=0), flags=flags)
        estimate.sigma_m[:, 2] = np.inf
        assert false_alarm_share([], estimate) == pytest.approx(1 / 30)
        assert score_fault(self.FAULT, estimate).named == 0
