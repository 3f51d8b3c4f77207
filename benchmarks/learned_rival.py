"""Train the network that reconstructs shapes without a model of the robot: `learned_rival.py --out FILE`.

Plans of the twin that vary loads, stiffness and sensors are simulated and reconstructed by the front end, and a torch
LSTM learns the nodes from the dR/R of all sensors. On two cores, an hour for 75 trials, nearly all of it for the twin.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import joblib
import numpy as np
import torch
from numpy.typing import NDArray

from tensegraph import Settings, Structure, open_trial, simulate
from tensegraph.io.model_file import read_sensor_model
from tensegraph.io.shape_network_file import write_shape_network
from tensegraph.models.calibration.torch_network import lstm_weights
from tensegraph.models.shape_network import LOG_SCALE_RANGE, ShapeNetwork
from tensegraph.pipeline import Pipeline

PLANS = Path(__file__).parents[1] / "examples" / "plans"
KINDS = ("press", "squeeze", "slack")
SHARE = (0.5, 0.3, 0.2)
"""Of each kind among the trials."""
TOP = {"press": "[5, 8, 11]", "squeeze": "[3, 7, 10]", "slack": "[5, 8, 11]"}
ANYWHERE = {"press": "[3, 4, 5, 6, 8, 9, 10, 11]", "squeeze": "[3, 4, 7, 9, 10]", "slack": "[5, 6, 8, 11]"}
HIDDEN = 96
CHANGE_SCALE = 0.1
DISPLACEMENT_SCALE_M = 0.01
STEPS = 500
"""Of frames through which the training goes back; the state begins at zero."""
BATCH = 16
EPOCHS = 60
GAIN_SIGMA = 0.03
"""Of a factor of each sensor's dR/R, drawn anew in each batch: no network may rely on one sensor's gain."""
NOISE_SIGMA = 0.002
"""Of dR/R, added in each batch."""
HELD_OUT = 0.15
"""Share of the trials that choose the epoch and give the covariance."""


def plan_text(seed: int) -> tuple[str, str]:
    """Return kind and text of a plan with varied loads and stiffness; its seed varies the sensors."""
    random = np.random.default_rng(seed)
    kind = str(random.choice(KINDS, p=SHARE))
    nodes = ANYWHERE[kind] if random.random() < 0.5 else TOP[kind]
    most_n = random.uniform(1.5, 3.5) if kind == "slack" else random.uniform(2.0, 5.0)
    spread = random.uniform(0.2, 0.7)
    return (
        kind,
        f"""extends = "{PLANS / kind}.toml"
name = "{kind}"
[mechanics]
tendon_stiffness_n_per_m = {400 * np.exp(0.1 * random.standard_normal()):.1f}
[[load.random]]
from_s = 2.0
until_s = 29.0
pause_s = [0.3, 1.5]
duration_s = [1.2, 4.5]
ramp_share = {random.uniform(0.2, 0.4):.2f}
nodes = {nodes}
together = [1, {random.integers(1, 3)}]
force_n = [0.5, {most_n:.1f}]
direction = {"[0.0, 0.0, 0.0]" if kind == "squeeze" else "[0.0, 0.0, -1.0]"}
direction_sigma = [{spread:.2f}, {spread:.2f}, 0.2]
""",
    )


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """One trial as the network sees it."""

    structure: Structure
    rest_length_m: NDArray[np.float64]
    change: NDArray[np.float64]
    """(frames, tendons) dR/R since the rest shape; a missing one holds its last."""
    displacement_m: NDArray[np.float64]
    """(frames, 3 free) from the rest shape, true."""


def example(path: Path) -> Example:
    """Return the example of a trial with truth."""
    trial = open_trial(path)
    truth = trial.truth()
    assert truth is not None, f"{path}: no truth"
    pipeline = Pipeline(trial.description, Settings(), read_sensor_model())
    frames = list(pipeline.lengths(trial.readings()))
    t_s = np.array([frame.t_s for frame in frames])
    held = np.zeros(len(trial.description.structure.tendons))
    change = []
    for frame in frames:
        assert frame.change_since_rest is not None, f"{path}: lengths"
        held = np.where(np.isfinite(frame.change_since_rest), frame.change_since_rest, held)
        change.append(held)
    structure = pipeline.rest.structure
    true = truth.node_position_m.reshape(len(truth.t_s), -1)[:, structure.free_coordinates]
    rest = pipeline.rest.node_position_m.ravel()[structure.free_coordinates]
    at_frames = np.stack([np.interp(t_s, truth.t_s, one) for one in true.T], axis=-1)
    rest_length_m = structure.tendon_length_m(pipeline.rest.node_position_m)
    return Example(structure, rest_length_m, np.array(change), at_frames - rest)


def simulated(seed: int, folder: Path) -> Example:
    """Return the example of a plan that is simulated."""
    kind, text = plan_text(seed)
    plan = folder / f"{kind}_{seed}.toml"
    plan.write_text(text)
    simulate(plan, folder / f"{kind}_{seed}", seed)
    return example(folder / f"{kind}_{seed}")


class Network(torch.nn.Module):
    """One LSTM and a linear head: displacements, and the log of the scale of their error."""

    def __init__(self, tendons: int, outputs: int) -> None:
        super().__init__()
        self.lstm = torch.nn.LSTM(tendons, HIDDEN, batch_first=True)
        self.head = torch.nn.Linear(HIDDEN, outputs + 1)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return (sequences, steps, outputs) displacements and (sequences, steps) log scales."""
        output = self.head(self.lstm(x)[0])
        return output[..., :-1], output[..., -1].clamp(*LOG_SCALE_RANGE)


def loss(error: torch.Tensor, log_scale: torch.Tensor) -> torch.Tensor:
    """Return the negative log likelihood of errors that have one scale in each frame."""
    square = (error**2).mean(dim=-1)
    return (0.5 * square * torch.exp(-2 * log_scale) + log_scale).mean()


def windows(examples: list[Example]) -> tuple[torch.Tensor, torch.Tensor]:
    """Return (windows, steps, tendons) inputs and (windows, steps, outputs) targets, scaled."""
    x, y = [], []
    for one in examples:
        for start in range(0, len(one.change) - STEPS + 1, STEPS // 2):
            x.append(one.change[start : start + STEPS] / CHANGE_SCALE)
            y.append(one.displacement_m[start : start + STEPS] / DISPLACEMENT_SCALE_M)
    return torch.tensor(np.array(x), dtype=torch.float32), torch.tensor(np.array(y), dtype=torch.float32)


def train(examples: list[Example], validation: list[Example]) -> Network:
    """Return the network of the epoch whose error on the validation is smallest."""
    torch.manual_seed(0)
    x, y = windows(examples)
    network = Network(x.shape[-1], y.shape[-1])
    optimizer = torch.optim.Adam(network.parameters(), lr=2e-3)
    scheduler = torch.optim.lr_scheduler.OneCycleLR(optimizer, 4e-3, EPOCHS * -(-len(x) // BATCH))
    best, kept = np.inf, network.state_dict()
    for epoch in range(EPOCHS):
        for rows in torch.randperm(len(x)).split(BATCH):
            gain = 1 + GAIN_SIGMA * torch.randn(len(rows), 1, x.shape[-1])
            noisy = gain * x[rows] + NOISE_SIGMA / CHANGE_SCALE * torch.randn_like(x[rows])
            mean, log_scale = network(noisy)
            optimizer.zero_grad()
            loss(mean[:, 20:] - y[rows][:, 20:], log_scale[:, 20:]).backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimizer.step()
            scheduler.step()
        error_m, _ = residuals(network, validation)
        rmse_m = float(np.sqrt(3 * np.mean(error_m**2)))
        if rmse_m < best:
            best, kept = rmse_m, {name: value.clone() for name, value in network.state_dict().items()}
        print(f"epoch {epoch + 1}: node RMSE {1e3 * rmse_m:.2f} mm on held-out trials", flush=True)
    network.load_state_dict(kept)
    return network


def residuals(network: Network, examples: list[Example]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (frames, outputs) errors in m of whole trials, and their (frames,) scales."""
    errors, scales = [], []
    with torch.no_grad():
        for one in examples:
            mean, log_scale = network(torch.tensor(one.change[None] / CHANGE_SCALE, dtype=torch.float32))
            errors.append(DISPLACEMENT_SCALE_M * mean[0].double().numpy() - one.displacement_m)
            scales.append(np.exp(log_scale[0].double().numpy()))
    return np.concatenate(errors), np.concatenate(scales)


def as_shape_network(network: Network, examples: list[Example], validation: list[Example]) -> ShapeNetwork:
    """Return the network as the estimator takes it, with the covariance of its errors on the validation."""
    parameters = {name: value.detach().double().numpy() for name, value in network.state_dict().items()}
    error_m, scale = residuals(network, validation)
    scaled = error_m / scale[:, None]
    structure = examples[0].structure
    return ShapeNetwork(
        weights=lstm_weights(parameters),
        change_scale=CHANGE_SCALE,
        displacement_scale_m=DISPLACEMENT_SCALE_M,
        covariance_m2=scaled.T @ scaled / len(scaled),
        rods=structure.rods,
        tendons=structure.tendons,
        anchors=structure.anchors,
        rest_length_m=np.mean([one.rest_length_m for one in examples], axis=0),
    )


def main() -> None:
    """Simulate, train, and write the network."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=75, help="number of simulated trials")
    parser.add_argument("--from", dest="folder", type=Path, help="folder of trials that are simulated already")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True, help="file of the network, *.safetensors")
    given = parser.parse_args()
    parallel = joblib.Parallel(n_jobs=given.jobs)
    with TemporaryDirectory() as folder:
        if given.folder:
            paths = sorted(path.parent for path in given.folder.glob("*/trial.toml"))
            examples = parallel(joblib.delayed(example)(path) for path in paths)
        else:
            examples = parallel(joblib.delayed(simulated)(5000 + k, Path(folder)) for k in range(given.trials))
    order = np.random.default_rng(0).permutation(len(examples))
    held_out = max(round(HELD_OUT * len(examples)), 1)
    validation, training = [examples[k] for k in order[:held_out]], [examples[k] for k in order[held_out:]]
    write_shape_network(as_shape_network(train(training, validation), training, validation), given.out)


if __name__ == "__main__":
    main()
