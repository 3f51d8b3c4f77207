"""The recurrent network alone."""

from dataclasses import replace
from itertools import takewhile

import numpy as np
import pytest
import torch

import tensegraph as tg
from learned_rival import Network, loss, plan_text
from tensegraph.estimator.baselines.recurrent_network import RecurrentNetwork
from tensegraph.io.plan_file import read_plan
from tensegraph.io.shape_network_file import read_shape_network, write_shape_network
from tensegraph.models.calibration.torch_network import lstm_weights
from tensegraph.models.evaluation.metrics import node_rmse_m
from tensegraph.models.sensor.lstm import LstmWeights
from tensegraph.models.shape_network import ShapeNetwork


@pytest.fixture
def network(structure, rest) -> ShapeNetwork:
    """A network of two cells whose head alone moves: its bias."""
    outputs = len(structure.free_coordinates)
    return ShapeNetwork(
        weights=LstmWeights(
            weight_ih=np.zeros((8, 24)),
            weight_hh=np.zeros((8, 2)),
            bias=np.zeros(8),
            head_weight=np.zeros((outputs + 1, 2)),
            head_bias=np.append(np.full(outputs, 0.5), np.log(2.0)),
        ),
        change_scale=0.1,
        displacement_scale_m=0.01,
        covariance_m2=1e-6 * np.eye(outputs),
        rods=structure.rods,
        tendons=structure.tendons,
        anchors=structure.anchors,
        rest_length_m=structure.tendon_length_m(rest.node_position_m),
    )


def changed(lengths: tg.TendonLengths, value: float) -> tg.TendonLengths:
    return replace(lengths, change_since_rest=np.full(24, value))


def test_by_hand(network, structure, rest, lengths_of) -> None:
    """0.5 times 10 mm from the rest shape; exp(log 2)^2 times the variance of 1 mm, and that of the rest shape."""
    shape = RecurrentNetwork(network, structure, rest).update(
        changed(lengths_of(structure, rest.node_position_m), 0.01)
    )
    moved_m = (shape.node_position_m - rest.node_position_m).ravel()
    np.testing.assert_allclose(moved_m[structure.free_coordinates], 0.005)
    assert not moved_m[:9].any()
    variance = np.diag(shape.covariance_m2)[structure.free_coordinates]
    np.testing.assert_allclose(variance, 4e-6 + 0.0003**2)


def test_numpy_and_torch_agree(tmp_path, structure, rest, lengths_of) -> None:
    """The training's network, written, read and stepped, gives what torch gives; a missing reading holds the last."""
    torch.manual_seed(1)
    trained = Network(24, len(structure.free_coordinates))
    parameters = {name: value.detach().double().numpy() for name, value in trained.state_dict().items()}
    size = len(structure.free_coordinates)
    rest_length_m = structure.tendon_length_m(rest.node_position_m)
    network = ShapeNetwork(
        lstm_weights(parameters),
        0.1,
        0.01,
        np.eye(size),
        structure.rods,
        structure.tendons,
        structure.anchors,
        rest_length_m,
    )
    write_shape_network(network, tmp_path / "network.safetensors")
    estimator = RecurrentNetwork(read_shape_network(tmp_path / "network.safetensors"), structure, rest)
    at_rest = lengths_of(structure, rest.node_position_m)
    shapes = [estimator.update(changed(at_rest, value)) for value in (0.0, 0.03, np.nan)]
    x = torch.tensor([[[0.0] * 24, [0.3] * 24, [0.3] * 24]])
    expected_m = 0.01 * trained(x)[0][0].detach().double().numpy()
    moved_m = np.array([(shape.node_position_m - rest.node_position_m).ravel() for shape in shapes])
    np.testing.assert_allclose(moved_m[:, structure.free_coordinates], expected_m, atol=1e-8)


def test_another_structure_is_refused(network, structure, rest) -> None:
    with pytest.raises(tg.InputError, match="got other tendons"):
        RecurrentNetwork(replace(network, tendons=network.tendons[::-1]), structure, rest)
    with pytest.raises(tg.InputError, match="got one 20% off"):
        RecurrentNetwork(replace(network, rest_length_m=network.rest_length_m / 1.2), structure, rest)


def test_lengths_are_not_enough(network, structure, rest, lengths_of) -> None:
    with pytest.raises(tg.InputError, match="expected counts or resistances, got lengths"):
        RecurrentNetwork(network, structure, rest).update(lengths_of(structure, rest.node_position_m))


@pytest.mark.parametrize("damage", [b"", b"{}", None])
def test_a_damaged_file_is_one_line(tmp_path, damage) -> None:
    path = tmp_path / "network.safetensors"
    if damage is not None:
        path.write_bytes(damage)
    with pytest.raises(tg.InputError, match=r"network\.safetensors: cannot be read"):
        read_shape_network(path)


def test_the_shipped_network_beats_holding_the_rest_shape(example) -> None:
    """In twelve seconds, in ten of which nodes are pressed."""
    trial = tg.open_trial(example)
    truth = trial.truth()
    readings = takewhile(lambda row: row.host_s < 12.0, trial.readings())
    result = tg.Reconstruction.of(trial.description.structure, tg.stream(readings, trial.description, "network"))
    held = replace(result, node_position_m=np.repeat(result.node_position_m[:1], len(result), axis=0))
    rmse_m = node_rmse_m(result, truth.t_s, truth.node_position_m)
    assert rmse_m < 0.7 * node_rmse_m(held, truth.t_s, truth.node_position_m)
    assert 0.0005 < np.median(result.node_sigma_m[:, trial.description.structure.free_nodes]) < 0.02


def test_the_loss_is_least_at_the_true_scale() -> None:
    """Errors of standard deviation 3: the likelihood is largest at log 3."""
    error = torch.tensor(3 * np.random.default_rng(0).standard_normal((1, 2000, 27)))
    losses = [float(loss(error, torch.full((1, 2000), scale))) for scale in np.log([2.0, 3.0, 4.0])]
    assert losses[1] == min(losses)


@pytest.mark.parametrize("seed", range(5000, 5006))
def test_every_varied_plan_is_a_plan(tmp_path, seed) -> None:
    kind, text = plan_text(seed)
    (tmp_path / "plan.toml").write_text(text)
    assert read_plan(tmp_path / "plan.toml").kind == kind
