"""`tensegraph calibrate`: model, card and figures, interrupted or not."""

import filecmp
import hashlib
import signal
import subprocess
import sys
import time

import numpy as np

from command_line import CALIBRATE, refusal_of, run


def test_calibrate_writes_model_card_and_figures(rig_folder, calibrated) -> None:
    assert calibrated.returncode == 0, calibrated.stderr
    assert "left out: strips/bad.csv: row 3, column resistance_ohm: expected a finite number, got 'x'" in (
        calibrated.stderr
    )
    assert "speed 0.03 /s" in calibrated.stdout
    assert "than the LSTM" in calibrated.stdout
    figures = {path.name: path.read_bytes() for path in (rig_folder / "m_figures").iterdir()}
    assert sorted(figures) == ["curves.png", "errors.png", "losses.png", "predictions.png", "sweep.png"]
    assert all(content.startswith(b"\x89PNG") for content in figures.values())
    card = (rig_folder / "m.md").read_text()
    digest = hashlib.sha256((rig_folder / "strips" / "s2.csv").read_bytes()).hexdigest()
    assert f"| s2.csv | test | `{digest}` |" in card
    assert "Left out:" in card
    assert "the paper's eq. (9) stands in" in card
    assert not list(rig_folder.glob("*.checkpoint"))


def test_ctrl_c_and_the_same_command_again_give_the_same_bytes(rig_folder, calibrated, undrawn) -> None:
    command = [sys.executable, "-m", "tensegraph", *CALIBRATE, "again.safetensors"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}

    def heed_ctrl_c() -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # a job in the background is started deaf to it

    with subprocess.Popen(command, cwd=rig_folder, preexec_fn=heed_ctrl_c, **quiet) as process:
        until = time.monotonic() + 60
        while not (rig_folder / "again.checkpoint").exists() and time.monotonic() < until:
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 130
    assert not (rig_folder / "again.safetensors").exists()
    assert run(*CALIBRATE, "again.safetensors", cwd=rig_folder).returncode == 0
    assert filecmp.cmp(rig_folder / "again.safetensors", rig_folder / "m.safetensors", shallow=False)


def test_a_model_that_no_command_would_take_leaves_nothing(tmp_path) -> None:
    """The gauge length is told ten times too short, and wires are loose: resistances are mostly noise."""
    (tmp_path / "strips").mkdir()
    rng = np.random.default_rng(0)
    for k in range(3):
        t_s = np.arange(0, 40, 0.2)
        stretch_m = 0.04 * np.abs((0.03 * t_s + 0.2) % 0.8 - 0.4)
        ohm = 1e6 * np.abs(1 + 100 * (32 + k) * stretch_m + 30 * rng.standard_normal(len(t_s)))
        rows = [f"{t:.2f},{r:.0f},{m:.6f}" for t, r, m in zip(t_s, ohm, stretch_m, strict=True)]
        (tmp_path / "strips" / f"s{k}.csv").write_text("\n".join([*rows, ""]))
    (tmp_path / "rig.toml").write_text(
        'gauge_length_mm = 3.3\nnatural_resistance_ohm = "start"\n[columns]\ntime = 1\nresistance = 2\n'
        'displacement = 3\n[units]\ntime = "s"\nresistance = "ohm"\ndisplacement = "m"\n'
    )
    command = ("calibrate", "strips", "--epochs", "1", "--out", "m.safetensors", "--rig", "rig.toml")
    refused = refusal_of(*command, cwd=tmp_path)
    assert "m.safetensors: not written: the recordings give a model that no command would take" in refused
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig.toml", "strips"]


def test_a_folder_whose_recordings_do_not_do_is_named(rig_folder) -> None:
    refused = refusal_of("calibrate", "strips", "--out", "x.safetensors", "--hold-out", "nothing*", cwd=rig_folder)
    assert refused == "tensegraph: strips: --hold-out nothing*: fits no recording\n"
