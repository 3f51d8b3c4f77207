"""The report of a calibration: table for the screen, model card, metadata of the model."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from rich.table import Table

from ...models.calibration.bending_fit import BendingFit
from ...models.calibration.calibrated_model import LSTM, Calibration
from ...models.calibration.strip_rig import StripRig
from ...models.calibration.strip_scores import StripScore, by_speed
from ...models.sensor.sensor_model import SensorModel, TrainedRanges
from ..calibration.recording_files import RecordingFolder, rig_text
from ..provenance import versions


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationReport:
    """A calibration, its recordings and its command."""

    calibration: Calibration
    folder: RecordingFolder
    rig: StripRig
    """The test rig of the recordings."""
    command: str
    """Command that makes the same model again."""
    seconds: float
    """Duration of the calibration."""

    def model(self) -> SensorModel:
        """Return the model with scores, data and versions in its provenance."""
        scores = {
            name: {run.name: asdict(StripScore.of([run])) for run in runs}
            for name, runs in self.calibration.runs.items()
        }
        provenance = replace(
            self.calibration.model.provenance,
            held_out=scores.pop(self.calibration.used),
            baselines=scores,
            split=self.calibration.split.how,
            data_sha256=self.folder.sha256,
            command=self.command,
            versions=versions("torch"),
        )
        return replace(self.calibration.model, provenance=provenance)

    def scores_by_speed(self) -> dict[str, dict[str, StripScore]]:
        """Return scores by group of recordings, then by estimator."""
        groups: dict[str, dict[str, StripScore]] = {}
        for name, runs in self.calibration.runs.items():
            for group, some in [*by_speed(runs).items(), ("all held out", list(runs))]:
                groups.setdefault(group, {})[name] = StripScore.of(some)
        return groups

    def verdict(self) -> str:
        """Return whether the network is better than the baselines, and what the model uses if it is not the network."""
        if not self.calibration.runs[LSTM]:
            return "Nothing of stretching was held out: the network is not scored."
        everything = self.scores_by_speed()["all held out"]
        best = min(everything, key=lambda name: everything[name].rmse)
        rmse = {
            name: np.array([StripScore.of([run]).rmse for run in runs]) for name, runs in self.calibration.runs.items()
        }
        wins = int(np.sum(rmse[LSTM] <= np.min(list(rmse.values()), axis=0)))
        counted = f"on {wins} of {len(rmse[LSTM])} of them"
        used = self.calibration.used
        uses = "" if used == LSTM else f" The model uses the {used}, which is better on the recordings for validation."
        if best == LSTM:
            return f"Over all held-out recordings the LSTM is better than all others; it is the best {counted}.{uses}"
        return f"Over all held-out recordings the {best} is better than the LSTM, which is the best {counted}.{uses}"

    def _chosen_lines(self) -> list[str]:
        network, curve = self.calibration.validation_rmse
        if np.isnan(network):
            return []
        return [
            "",
            f"On the recordings for validation the RMSE of strain is {network:.4f} with the LSTM, and {curve:.4f} with "
            f"the curve of rates alone. The model uses the {self.calibration.used}.",
        ]

    def table(self) -> Table:
        """Return the table of scores for the screen."""
        table = Table("held out", "", "RMSE, strain", "R²", "68 % band", "95 % band", "median sigma")
        for group, estimators in self.scores_by_speed().items():
            for k, (name, score) in enumerate(estimators.items()):
                table.add_row(group if k == 0 else "", name, *_cells(score), end_section=k == len(estimators) - 1)
        return table

    def card(self) -> str:
        """Return the model card, in Markdown."""
        sections = [
            ("", [self.verdict(), *self._chosen_lines()]),
            ("Errors on recordings held out", self._error_lines()),
            ("Sigma", self._sigma_lines()),
            ("Bending", _bending_lines(self.calibration.bending)),
            ("Ranges", _range_lines(self.calibration.model.ranges)),
            ("Data", self._data_lines()),
            ("To make it again", self._again_lines()),
        ]
        lines = ["# Strain sensor model", ""]
        for title, body in sections:
            lines += [*([f"## {title}", ""] if title else []), *body, ""]
        return "\n".join(lines)

    def _error_lines(self) -> list[str]:
        return [
            f"Split: {self.calibration.split.how}. A strip not trained on is tared on its first 10 s, which do not "
            "count. Strain is a fraction of the natural length.",
            "",
            "| held out | estimator | RMSE | R² | in 68 % band | in 95 % band | median sigma | correlation time |",
            "|---|---|---|---|---|---|---|---|",
            *(
                f"| {group} | {name} | {' | '.join(_cells(score))} | {score.correlation_s:.1f} s |"
                for group, estimators in self.scores_by_speed().items()
                for name, score in estimators.items()
            ),
            "",
            f"Recording by recording, the {self.calibration.used}:",
            "",
            "| recording | RMSE | R² | in 68 % band | in 95 % band | median sigma | correlation time | flagged |",
            "|---|---|---|---|---|---|---|---|",
            *(
                f"| {run.name} | {' | '.join(_cells(score))} | {score.correlation_s:.1f} s | {score.beyond:.0%} |"
                for run in self.calibration.runs[self.calibration.used]
                for score in [StripScore.of([run])]
            ),
        ]

    def _sigma_lines(self) -> list[str]:
        scale = self.calibration.model.sigma_scale
        gauge = self.calibration.model.gauge
        return [
            "The network's sigma is multiplied by b s^p, s being the strain's spread over the last 30 s: "
            f"b = {scale.factor:.3f}, p = {scale.power:.3f}, the most likely ones on the validation recordings "
            f"({', '.join(r.name for r in self.calibration.split.validation)}). What taring leaves unknown of a strip "
            f"is added: gains differ by {gauge.gain_sigma:.3f} between strips, offsets by "
            f"{gauge.offset_sigma:.4f} of dR/R."
        ]

    def _data_lines(self) -> list[str]:
        return [
            "| file | used for | SHA-256 |",
            "|---|---|---|",
            *(f"| {name} | {self._use(name)} | `{digest}` |" for name, digest in self.folder.sha256.items()),
            *(["", "Left out:", ""] if self.folder.left_out else []),
            *(f"- {line}" for line in self.folder.left_out),
        ]

    def _again_lines(self) -> list[str]:
        history = self.calibration.trained.history
        recipe = self.calibration.model.provenance.recipe
        rig = ["With RIG.toml:", "", "```toml", *rig_text(self.rig).splitlines(), "```", ""]
        return [
            "```sh",
            self.command,
            "```",
            "",
            *(rig if self.rig != StripRig() else []),
            f"Versions: {', '.join(f'{name} {number}' for name, number in versions('torch').items())}. On one machine "
            "with these versions the model file comes out the same to the bit. Stopped after epoch "
            f"{len(history.training_loss)}, kept epoch {history.best_epoch}. It took {self.seconds:.0f} s.",
            "",
            "Recipe: " + ", ".join(f"{name} = {value}" for name, value in recipe.items()) + ".",
        ]

    def _use(self, file_name: str) -> str:
        name = Path(file_name).stem
        split = self.calibration.split
        groups = {"training": split.training, "validation": split.validation, "test": split.held_out}
        return ", ".join(use for use, recordings in groups.items() if any(r.name == name for r in recordings))


def _cells(score: StripScore) -> list[str]:
    percent = f"{score.coverage_68:.0%}", f"{score.coverage_95:.1%}"
    return [f"{score.rmse:.4f}", f"{score.r2:.4f}", *percent, f"{score.median_sigma:.4f}"]


def _range_lines(ranges: TrainedRanges) -> list[str]:
    return [
        f"- dR/R {ranges.change[0]:.3f} to {ranges.change[1]:.3f}; beyond, strain is extrapolated, flagged, and "
        "its sigma grows with the distance",
        f"- rate of dR/R up to {ranges.rate_per_s:.3g} /s, of strain up to {ranges.strain_rate_per_s:.3g} /s "
        "(99.9 % of the training); beyond, samples are flagged, and sigma grows with the excess, and for 3 s after",
        f"- strain 0 to {ranges.strain[1]:.3f}",
        f"- time steps of {ranges.step_s[0]:g} to {ranges.step_s[1]:g} s",
    ]


def _bending_lines(bending: BendingFit | None) -> list[str]:
    if bending is None:
        return ["No recording bends by more than 0.1: the paper's eq. (9) stands in."]
    sigmas = np.sqrt(np.diag(bending.covariance))
    terms = [
        f"{value:+.4f} (sigma {sigma:.4f}) x^{5 - k}"
        for k, (value, sigma) in enumerate(zip(bending.coefficients, sigmas, strict=True))
    ]
    fold = bending.curve().polynomial
    held_out = "nothing held out" if np.isnan(bending.held_out_r2) else f"held out {bending.held_out_r2:.5f}"
    return [
        f"dR/R = {' '.join(terms)}, x = strain, with the lag undone; the constant is left out in use. "
        f"R² = {bending.r2:.5f}, {held_out}; residual {bending.residual_sigma:.4f}. "
        f"Invertible for strain {max(fold.x_min, bending.lowest_strain):.3f} to {fold.x_fold:.4f}, that is dR/R "
        f"{float(fold.value(max(fold.x_min, bending.lowest_strain))):.3f} to {fold.y_fold:.4f}; recorded down to "
        f"{bending.lowest_strain:.3f}. The coefficients' covariance is in the model file, as `bending_covariance`.",
    ]
