"""What calibrate writes: whole, and never over what is not ours."""

import pytest

from tensegraph import InputError
from tensegraph.io.calibration.calibration_output import CalibrationPaths


class TestOutput:
    def test_nothing_is_half_written(self, tmp_path) -> None:
        paths = CalibrationPaths(tmp_path / "m.safetensors")
        paths.checkpoint.write_text("state")
        with pytest.raises(RuntimeError, match="stop"), paths.written_whole() as inside:  # noqa: PT012
            inside.card.write_text("half")
            raise RuntimeError("stop")
        assert [p.name for p in tmp_path.iterdir()] == ["m.checkpoint"]
        with paths.written_whole() as inside:
            inside.card.write_text("card")
            inside.model.write_text("model")
        assert sorted(p.name for p in tmp_path.iterdir()) == ["m.md", "m.safetensors", "m_figures"]

    def test_what_is_not_ours_is_not_replaced(self, tmp_path) -> None:
        (tmp_path / "m_figures").mkdir()
        (tmp_path / "m_figures" / "thesis.txt").write_text("mine")
        for name, message in [
            ("m.safetensors", "holds more"),
            ("m.pt", r"ends in \.safetensors"),
            ("x/m.safetensors", "no such"),
        ]:
            with pytest.raises(InputError, match=message):
                CalibrationPaths(tmp_path / name).check()

    def test_notes_beside_a_new_model_are_not_taken_for_its_card(self, tmp_path) -> None:
        (tmp_path / "README.md").write_text("mine")
        with pytest.raises(InputError, match=r"README\.md: exists without README\.safetensors"):
            CalibrationPaths(tmp_path / "README.safetensors").check()

    def test_only_checkpoints_of_its_own_are_removed(self, tmp_path) -> None:
        """Of the trainings at 0.003 and 1e-05; another program has the others."""
        paths = CalibrationPaths(tmp_path / "m[1].safetensors")
        others = ["m[1].best.checkpoint", "m1.0.003.checkpoint", "n.0.003.checkpoint"]
        for path in (
            paths.checkpoint,
            paths.of_rate(0.003),
            paths.of_rate(1e-5),
            *(tmp_path / name for name in others),
        ):
            path.write_text("state")
        with paths.written_whole() as inside:
            inside.card.write_text("card")
            inside.model.write_text("model")
        assert sorted(p.name for p in tmp_path.glob("*.checkpoint")) == sorted(others)
