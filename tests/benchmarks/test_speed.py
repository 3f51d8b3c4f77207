"""Speed, side by side with what a user would otherwise pick. Not part of the default run:

pytest -n 0 tests/benchmarks --benchmark-only
"""

import resource
from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Reconstruction, Settings, open_trial
from tensegraph.commands.simulate import simulate
from tensegraph.estimator.baselines.least_squares import LeastSquares
from tensegraph.estimator.baselines.unscented_kalman import UnscentedKalman
from tensegraph.estimator.batch import BatchOptimizer
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.models.evaluation.metrics import evaluate
from tensegraph.models.sensor.stretching import StretchingSensors
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.values.readings import TendonLengths
from tensegraph.pipeline import OFFLINE_FRAMES, Pipeline


@pytest.fixture(scope="module")
def measured(example, model):
    """The example's pipeline, and the lengths of all its frames."""
    trial = open_trial(example)
    pipeline = Pipeline(trial.description, Settings(), model)
    return pipeline, list(pipeline.lengths(trial.readings()))


PLAIN, WHOLE = "lengths alone", "with equilibrium"


def rest_of(pipeline: Pipeline, what: str) -> RestShape:
    """With lengths alone, no forces, loads or health."""
    return replace(pipeline.rest, mechanics=None) if what == PLAIN else pipeline.rest


@pytest.mark.parametrize(
    ("estimator", "what"),
    [(LiveSmoother, PLAIN), (LiveSmoother, WHOLE), (UnscentedKalman, PLAIN), (LeastSquares, PLAIN)],
)
def test_one_live_frame(benchmark, measured, estimator, what) -> None:
    """Estimate and covariances of one frame of the example against a UKF and scipy's least squares."""
    pipeline, frames = measured
    running, coming = estimator(pipeline.trial.structure, rest_of(pipeline, what), Settings()), iter(frames)
    benchmark.pedantic(running.update, setup=lambda: ((next(coming),), {}), rounds=len(frames))
    benchmark.extra_info["p99_ms"] = 1e3 * float(np.quantile(benchmark.stats.stats.data, 0.99))


@pytest.mark.parametrize(("frames", "what"), [(375, WHOLE), (750, WHOLE), (1500, WHOLE), (1500, PLAIN)])
def test_batch_with_all_covariances(benchmark, measured, frames, what) -> None:
    pipeline, lengths = measured
    part = (lengths * 2)[:frames] if frames > len(lengths) else lengths[:frames]
    part = [TendonLengths(0.02 * k, f.length_m, f.sigma_m, f.mode, f.flags) for k, f in enumerate(part)]
    batch = BatchOptimizer(pipeline.trial.structure, rest_of(pipeline, what), Settings())
    benchmark.pedantic(lambda: list(batch.estimate(part)), rounds=1)
    benchmark.extra_info["ms_per_frame"] = 1e3 * benchmark.stats.stats.mean / frames


def test_memory_over_20_000_live_frames(benchmark, measured) -> None:
    """Peak resident memory grows by less than 5 MB from frame 2000 to 20 000."""
    pipeline, lengths = measured

    def run() -> int:
        running, early = LiveSmoother(pipeline.trial.structure, pipeline.rest, Settings()), 0
        for k in range(20_000):
            f = lengths[k % len(lengths)]
            running.update(TendonLengths(0.02 * k, f.length_m, f.sigma_m, f.mode, f.flags))
            if k == 2000:
                early = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - early

    grown_kb = benchmark.pedantic(run, rounds=1)
    benchmark.extra_info["grown_kb"] = grown_kb
    assert grown_kb < 5000


def test_one_step_of_24_sensors(benchmark, model) -> None:
    sensors, change = StretchingSensors(model, 24), np.full((1, 24), 0.08)
    benchmark(sensors.run, change, np.zeros((1, 24)), np.full((1, 1), 0.02))


@pytest.mark.parametrize("ahead", [1, OFFLINE_FRAMES])
def test_readings_to_lengths(benchmark, example, model, ahead) -> None:
    """Everything before the estimator, per output frame, live and offline."""
    rows = list(open_trial(example).readings())

    def run() -> int:
        return len(list(Pipeline(open_trial(example).description, Settings(), model).lengths(rows, ahead)))

    frames = benchmark.pedantic(run, rounds=3)
    assert frames > 1400
    benchmark.extra_info["us_per_frame"] = 1e6 * benchmark.stats.stats.median / frames


def test_evaluation_of_a_trial(benchmark, measured, example) -> None:
    """All numbers of 1500 frames against the truth."""
    pipeline, frames = measured
    structure, rest = pipeline.trial.structure, pipeline.rest
    shapes = LiveSmoother(structure, rest, Settings()).estimate(frames)
    estimate, trial = Reconstruction.of(structure, shapes), open_trial(example)
    truth = trial.truth_of(trial.truth())
    result = benchmark(evaluate, rest.node_position_m, estimate, truth)
    assert result.frames > 1400


@pytest.mark.parametrize("plan", ["press", "slack", "prism"])
def test_thirty_simulated_seconds(benchmark, tmp_path, example, plan) -> None:
    """A plan to its trial on disk: should take less than the 30 s that it lasts."""
    path = example.parent / "plans" / f"{plan}.toml"
    benchmark.pedantic(simulate, setup=lambda: ((path, tmp_path / "trial"), {}), rounds=1)
