"""The boards of a rig from Python."""

import shutil
import time
from itertools import islice, pairwise

import pytest

import tensegraph as tg


def test_shapes_come_from_boards_on_ptys_and_are_recorded(tmp_path, rig, two_boards) -> None:
    said: list[str] = []
    ports = [str(board.port) for board in two_boards]
    with tg.Boards(rig, ports=ports, record=tmp_path / "recorded", say=said.append) as boards:
        shapes = list(islice(boards, 20))
        boards.stop()
    assert all(later.t_s > shape.t_s for shape, later in pairwise(shapes))
    assert shapes[0].node_position_m.shape == (two_boards[0].channels, 3)
    assert said[0] == "looking for boards ..."
    assert tg.open_trial(tmp_path / "recorded").row_count() >= 2 * len(shapes)


def test_a_loop_that_was_left_goes_on(rig, two_boards) -> None:
    """The sensors are not tared anew: the second loop has the frames after those of the first."""
    ports = [str(board.port) for board in two_boards]
    with tg.Boards(rig, ports=ports, say=lambda said: None) as boards:
        first = list(islice(boards, 10))
        second = list(islice(boards, 10))
        boards.stop()
    assert first[-1].t_s < second[0].t_s < first[-1].t_s + 1.0


def test_a_loop_that_takes_longer_than_the_frames_is_given_the_newest(rig, two_boards) -> None:
    """Ten frames pass in each of its turns. All were given before, until none was left but those without readings."""
    ports = [str(board.port) for board in two_boards]
    shapes = []
    with tg.Boards(rig, ports=ports, say=lambda said: None) as boards:
        begun_s = time.perf_counter()
        for shape in boards:
            shapes.append(shape)
            late_s = time.perf_counter() - begun_s - shape.t_s
            if len(shapes) == 15:
                boards.stop()
                break
            time.sleep(0.2)
    assert late_s < 1.0
    assert boards.skipped_frames > 70


def test_a_recording_that_cannot_be_or_ends_early_is_told(tmp_path, rig, two_ports) -> None:
    """Where a trial stands before anything is done; where the files vanish at the end, with the shapes so far."""
    ports, path = two_ports[1::2], tmp_path / "recorded"
    shapes = []

    def record() -> None:
        with tg.Boards(rig, ports=ports, record=path, say=lambda said: None) as boards:
            for shape in boards:
                shapes.append(shape)
                if len(shapes) == 20:
                    shutil.rmtree(path)
                    boards.stop()

    with pytest.raises(tg.TensegraphError, match="recorded: the recording ended: its files are gone"):
        record()
    assert len(shapes) >= 20
    path.mkdir()
    with pytest.raises(tg.TensegraphError, match="recorded: exists"):
        record()


def test_boards_that_fall_silent_while_they_are_tared(tmp_path, rig, pty_boards, monkeypatch) -> None:
    """Their cables are out as soon as the taring begins."""
    monkeypatch.setattr("tensegraph.live.rig.SILENT_S", 0.2)
    rig.write_text(rig.read_text().replace("seconds = 2.0", "seconds = 1.0"))
    boards_on_ptys = [pty_boards(name, k) for k, name in enumerate(("zero", "one"))]

    def unplug(said: str) -> None:
        if said.startswith("taring"):
            for board in boards_on_ptys:
                board.unplug()

    boards = tg.Boards(rig, ports=[str(board.port) for board in boards_on_ptys], say=unplug)
    silent = r"the boards fell silent 0\.\d s after the start of the taring, which takes 1 s: see tensegraph ports"
    with pytest.raises(tg.TensegraphError, match=silent), boards:
        pass


def test_a_board_whose_sensors_are_not_tared_is_named(rig, pty_boards, monkeypatch) -> None:
    """Its cable is out; the sensors of the other stand still."""
    monkeypatch.setattr("tensegraph.live.rig.PATIENCE_S", 0.5)
    rig.write_text(rig.read_text().replace("seconds = 2.0", "seconds = 1.0"))
    zero, said = pty_boards("zero", 0), []
    zero.codes = lambda: (512,) * 12
    with tg.Boards(rig, ports=[str(zero.port)], say=said.append):
        pass
    assert said[-2].startswith("tared: tendons changed by 0.0 mm on average")
    assert said[-1].startswith("board 1: no row meanwhile: its sensors are not tared")


def test_boards_are_entered_first(rig) -> None:
    with pytest.raises(tg.TensegraphError, match="expected 'with"):
        next(iter(tg.Boards(rig)))


def test_no_board_answers(tmp_path, rig, monkeypatch) -> None:
    monkeypatch.setattr("tensegraph.live.rig.PATIENCE_S", 0.1)
    with pytest.raises(tg.TensegraphError, match="no board"), tg.Boards(rig, ports=[str(tmp_path / "none")]):
        pass
