"""`tensegraph view`: what a user types, and what the viewer gets."""

import re
import shutil
import signal
import subprocess
import sys
import urllib.request

import numpy as np
import pytest

from command_line import refusal_of, run
from tensegraph.commands.view import read_viewed
from tensegraph.io.reports.terminal import Terminal


def test_what_is_no_result_is_refused(tmp_path) -> None:
    pytest.importorskip("rerun")
    refused = run("view", "nothing", cwd=tmp_path)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr == "tensegraph: nothing: is no result: expected a directory with run.toml\n"


def test_two_results_of_one_name_are_refused(done) -> None:
    folder, *_ = done
    assert "two of these are named live" in refusal_of("view", "live", "./live", cwd=folder)


def test_without_rerun_one_line_says_what_to_install(done, monkeypatch) -> None:
    folder, *_ = done
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert refusal_of("view", "live", cwd=folder).endswith("pip install 'tensegraph[rerun]'\n")


def test_the_truth_stands_at_the_frames(done) -> None:
    """Its sampling rate is another; each frame has the nearest."""
    folder, *_ = done
    viewed = read_viewed(folder / "live", "live", Terminal(quiet=True))
    truth_s = np.genfromtxt(folder / "press" / "truth.csv", delimiter=",", skip_header=1)[:, 0]
    nearest = np.abs(truth_s[:, None] - viewed.result.t_s).argmin(axis=0)
    np.testing.assert_array_equal(viewed.truth.t_s, truth_s[np.unique(nearest)])
    assert viewed.rest_position_m.shape == (12, 3)


def test_a_result_without_its_trial_is_shown_alone(done, tmp_path, capsys) -> None:
    folder, *_ = done
    shutil.copytree(folder / "live", tmp_path / "moved")
    viewed = read_viewed(tmp_path / "moved", "moved", Terminal())
    assert viewed.truth is None
    assert viewed.rest_position_m is None
    assert re.search(r"moved: shown without rest shape and truth: .*trial.toml: no such file", capsys.readouterr().out)


def test_the_page_is_there_until_ctrl_c(done) -> None:
    pytest.importorskip("rerun")
    folder, *_ = done
    command = [sys.executable, "-m", "tensegraph", "view", "live", "results/press"]
    viewer = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert "Ctrl-C ends it" in viewer.stdout.readline()
        url = viewer.stdout.readline().strip()
        with urllib.request.urlopen(url, timeout=10) as page:
            assert page.status == 200
        viewer.send_signal(signal.SIGINT)
        _, error = viewer.communicate(timeout=20)
        assert (viewer.returncode, error) == (0, "")
    finally:
        viewer.kill()
        viewer.communicate()
