"""The files of a calibration: the model, its card and its figures, and the checkpoint of a training that is running."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ...models.values.errors import InputError
from ..whole import check_writable, written_whole


@dataclass(frozen=True, slots=True)
class CalibrationPaths:
    """The three outputs of a calibration, side by side."""

    model: Path
    """Path of the model file, *.safetensors."""

    @property
    def card(self) -> Path:
        """The model card."""
        return self.model.with_suffix(".md")

    @property
    def figures(self) -> Path:
        """The directory of figures."""
        return self.model.with_name(f"{self.model.stem}_figures")

    @property
    def checkpoint(self) -> Path:
        """The state of an unfinished training."""
        return self.model.with_suffix(".checkpoint")

    def of_rate(self, learning_rate: float) -> Path:
        """Return the path of the state of a short training at a learning rate, which stays until the model is there."""
        return self.model.with_suffix(f".{learning_rate:g}.checkpoint")

    def check(self) -> None:
        """Check, before any work, that all outputs can be written.

        Raises:
            InputError: when something else exists at the path of an output, or the directory cannot be written to.
        """
        if self.model.suffix != ".safetensors":
            raise InputError(f"{self.model}: expected a name that ends in .safetensors")
        if not self.model.parent.is_dir():
            raise InputError(f"{self.model.parent}: no such directory")
        check_writable(self.model)
        for path in (self.model, self.card, self.checkpoint):
            if path.is_dir():
                raise InputError(f"{path}: is a directory: expected a new name, or an earlier file")
        if self.card.exists() and not self.model.exists():
            raise InputError(
                f"{self.card}: exists without {self.model.name}, and would be replaced: expected a new name"
            )
        figures = self.figures
        if figures.exists() and not (figures.is_dir() and all(path.suffix == ".png" for path in figures.iterdir())):
            raise InputError(f"{figures}: exists and holds more than an earlier run's figures")

    @contextmanager
    def written_whole(self) -> Iterator["CalibrationPaths"]:
        """Give temporary paths to write to; all are moved into place if the block succeeds, the model last."""
        with written_whole(self.figures, self.card, self.model) as (*_, model):
            inside = CalibrationPaths(model)
            inside.figures.mkdir()
            yield inside
        self.remove_checkpoints()

    def remove_checkpoints(self) -> None:
        """Remove the states of trainings, from which nothing more is made."""
        self.checkpoint.unlink(missing_ok=True)
        of_rates = re.compile(rf"{re.escape(self.model.stem)}\.[-+.e\d]+\.checkpoint")
        for path in self.model.parent.iterdir():
            if of_rates.fullmatch(path.name):
                path.unlink()


@dataclass(frozen=True, slots=True)
class CheckpointFile:
    """The state of a training on disk."""

    path: Path
    """Path of the checkpoint file."""

    def load(self) -> bytes | None:
        """Return the state that was saved last; None if there is none."""
        return self.path.read_bytes() if self.path.is_file() else None

    def save(self, state: bytes) -> None:
        """Store a state in place of the last one, completely or not at all."""
        with written_whole(self.path) as (inside,):
            inside.write_bytes(state)
