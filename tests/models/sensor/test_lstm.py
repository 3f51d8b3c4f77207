"""The LSTM of eqs. (10)-(15), against a step by hand and against torch."""

import numpy as np
import pytest

from tensegraph.models.sensor.lstm import Lstm, LstmState, LstmWeights


class TestLstm:
    def test_one_step_by_hand(self) -> None:
        """One unit, weights 0, biases (i, f, g, o) = (0, 0, 1, 0): c = c/2 + tanh(1)/2, h = tanh(c)/2."""
        lstm = Lstm(
            LstmWeights(
                np.zeros((4, 1)), np.zeros((4, 1)), np.array([0, 0, 1.0, 0]), np.array([[2.0]]), np.array([3.0])
            )
        )
        output, state = lstm.run(np.array([[[7.0]]]), LstmState(np.array([[0.1]]), np.array([[0.4]])))
        c = 0.2 + 0.5 * np.tanh(1)
        assert state.c[0, 0] == pytest.approx(c)
        assert output[0, 0, 0] == pytest.approx(2 * 0.5 * np.tanh(c) + 3)

    def test_equals_torch(self) -> None:
        torch = pytest.importorskip("torch")
        torch.manual_seed(3)
        reference, head = torch.nn.LSTM(3, 5, batch_first=True).double(), torch.nn.Linear(5, 2).double()
        weights = {name: p.detach().numpy() for name, p in reference.named_parameters()}
        lstm = Lstm(
            LstmWeights(
                weights["weight_ih_l0"],
                weights["weight_hh_l0"],
                weights["bias_ih_l0"] + weights["bias_hh_l0"],
                head.weight.detach().numpy(),
                head.bias.detach().numpy(),
            )
        )
        x = np.random.default_rng(4).standard_normal((6, 50, 3))
        with torch.no_grad():
            expected = head(reference(torch.tensor(x))[0]).numpy()
        steps = np.swapaxes(x, 0, 1)
        first, state = lstm.run(steps[:20], lstm.initial_state(6))
        others, _ = lstm.run(steps[20:], state)
        np.testing.assert_allclose(np.swapaxes(np.concatenate([first, others]), 0, 1), expected, atol=1e-12)
