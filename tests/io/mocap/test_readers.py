"""Files of motion capture: each as its program writes it, and what is wrong with others, by row and column."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from capture_files import motive_text, qualisys_text, take_of, trc_text, vicon_text, write_c3d
from tensegraph import InputError
from tensegraph.io.mocap import c3d_file
from tensegraph.io.mocap.truth_file import read_truth
from tensegraph.models.values.tracks import MarkerTracks, StampedPositions

TAKE = take_of(np.array([0.0, 2.0, 3.0]), np.random.default_rng(0).random((3, 4, 3)), [2, 0, 3], gaps=1)
TEXTS = {"take.csv": motive_text, "vicon.csv": vicon_text, "take.tsv": qualisys_text, "take.trc": trc_text}


@pytest.fixture
def path_of(tmp_path):
    """Writes the take by the name of its file."""

    def write(name, edit=lambda text: text):
        path = tmp_path / name
        if name.endswith(".c3d"):
            write_c3d(TAKE, path)
        else:
            path.write_text(edit(TEXTS[name](TAKE)), newline="")
        return path

    return write


@pytest.mark.parametrize("name", [*TEXTS, "take.c3d"])
def test_a_file_as_its_program_writes_it(path_of, name) -> None:
    """Millimetres become metres, blank cells nan; the axes stay those of the capture."""
    tracks = read_truth(path_of(name), 4)
    assert isinstance(tracks, MarkerTracks)
    names = [f"Robot:{name}" for name in TAKE.names] if name == "vicon.csv" else list(TAKE.names)
    extra = ["Base"] if name == "take.csv" else []
    assert list(tracks.names) == extra + names
    np.testing.assert_allclose(tracks.t_s, TAKE.t_s, atol=1e-6)
    read_m = tracks.position_m[:, len(extra) :]
    assert np.isnan(read_m).any()
    np.testing.assert_allclose(read_m, 1e-3 * TAKE.position_mm, atol=1e-6)
    np.testing.assert_array_equal(
        tracks.position_m[:, : len(extra)], np.broadcast_to([3.0, 0, 0], (len(TAKE.t_s), len(extra), 3))
    )


def test_motive_by_hand(tmp_path) -> None:
    """Version 1.22 without labels, metres, and the markers that a rigid body expects where none was measured."""
    path = tmp_path / "take.csv"
    path.write_text(
        'Format Version,1.22,Take Name,"a, b",Length Units,Meters\n\n'
        ",,Rigid Body Marker,Rigid Body Marker,Rigid Body Marker,Marker,Marker,Marker\n"
        ",,A:1,A:1,A:1,A:2,A:2,A:2\n,,Position,Position,Position,Position,Position,Position\n"
        "Frame,Time (Seconds),X,Y,Z,X,Y,Z\n0,0.0,1,2,3,,,\n1,0.5,1,2,4,7,8,9\n"
    )
    tracks = read_truth(path, 4)
    assert tracks.names == ("A:1", "A:2")
    np.testing.assert_array_equal(tracks.position_m[:, 0], [[1, 2, 3], [1, 2, 4]])
    np.testing.assert_array_equal(tracks.position_m[:, 1], [[np.nan] * 3, [7, 8, 9]])


def test_vicon_after_another_section(path_of, tmp_path) -> None:
    path = path_of("vicon.csv", lambda text: f"Devices\n1000\n,,Force\nFrame,Sub Frame,Fx\n,,N\n1,0,2\n\n{text}\n")
    assert read_truth(path, 4).names[0] == "Robot:Unlabeled 1000"


@pytest.mark.parametrize("word", ["Events\n100", "EVENTS"])
def test_vicon_after_its_events(path_of, word) -> None:
    events = f"{word}\nSubject,Context,Name,Time (s),Description\nRobot,General,press,1.25,\n\n"
    assert read_truth(path_of("vicon.csv", lambda text: events + text), 4).names[0] == "Robot:Unlabeled 1000"


def test_vicon_with_tabs(path_of) -> None:
    """As Nexus writes its .txt."""
    tracks = read_truth(path_of("vicon.csv", lambda text: text.replace(",", "\t")), 4)
    np.testing.assert_allclose(tracks.position_m, 1e-3 * TAKE.position_mm, atol=1e-6)


@pytest.mark.parametrize("name", ["vicon.csv", "take.tsv", "take.trc", "take.c3d"])
def test_a_hidden_marker_that_is_written_as_zeros(tmp_path, name) -> None:
    """One that is at 0, 0, 0 whenever it is seen stands there, such as the corner of a simulated base."""
    was_hidden = np.isnan(TAKE.position_mm)
    position_mm = np.where(was_hidden, 0.0, TAKE.position_mm)
    position_mm[:, 3] = 0.0
    take = replace(TAKE, position_mm=position_mm)
    path = tmp_path / name
    write_c3d(take, path) if name == "take.c3d" else path.write_text(TEXTS[name](take))
    read_m = read_truth(path, 4).position_m
    assert was_hidden[:, :3].any()
    np.testing.assert_array_equal(np.isnan(read_m[:, :3]), was_hidden[:, :3])
    np.testing.assert_array_equal(read_m[:, 3], np.zeros_like(read_m[:, 3]))


@pytest.mark.parametrize("types", [True, False])
@pytest.mark.parametrize("header", [True, False])
def test_qualisys_without_frame_and_time(path_of, header: bool, types: bool) -> None:
    """Times follow from the rate then, and markers that are hidden leave blanks, all of them at once, too."""
    cells = [line.split("\t") for line in qualisys_text(TAKE).splitlines()]
    names = next(k for k, row in enumerate(cells) if row[0] == "MARKER_NAMES")
    rows = [row[2:] for row in cells[names + 3 :]]
    rows[0][:3] = [""] * 3
    rows[5] = [""] * len(rows[5])
    kept = [*cells[: names + 1], *(cells[names + 1 : names + 2] if types else [])]
    kept += [cells[names + 2][2:]] if header else []
    text = "\n".join("\t".join(row) for row in [*kept, *rows])
    tracks = read_truth(path_of("take.tsv", lambda _: text), 4)
    np.testing.assert_allclose(tracks.t_s, TAKE.t_s, atol=1e-9)
    position_mm = TAKE.position_mm.copy()
    position_mm[0, 0] = position_mm[5] = np.nan
    np.testing.assert_allclose(tracks.position_m, 1e-3 * position_mm, atol=1e-6)


@pytest.mark.parametrize("hidden", ["NULL", "NA", "NaN"])
def test_qualisys_of_version_2_with_an_external_trigger(path_of, hidden: str) -> None:
    """It has no rate then, and the column Time has the times; a word stands in place of a hidden marker."""
    text = f"FILE_VERSION\t2.0.0\n{qualisys_text(TAKE)}".replace("FREQUENCY\t100", "FREQUENCY\tEXT", 1)
    lines = text.splitlines()
    rows = [line.split("\t") for line in lines[13:]]
    assert any(cell == "" for row in rows for cell in row)
    words = ["\t".join(cell or hidden for cell in row) for row in rows]
    tracks = read_truth(path_of("take.tsv", lambda _: "\n".join([*lines[:13], *words])), 4)
    np.testing.assert_allclose(tracks.t_s, TAKE.t_s, atol=1e-5)
    np.testing.assert_allclose(tracks.position_m, 1e-3 * TAKE.position_mm, atol=1e-6)


def test_c3d_of_more_points_than_its_first_labels_hold(tmp_path) -> None:
    """The names of the 256th and later points are in LABELS2."""
    names = [f"M{number}" for number in range(520)]
    position_mm = np.random.default_rng(0).random((3, 520, 3))
    write_c3d(replace(TAKE, t_s=TAKE.t_s[:3], names=names, position_mm=position_mm), tmp_path / "take.c3d")
    assert list(read_truth(tmp_path / "take.c3d", 4).names) == names


def test_positions_of_nodes_stay_what_they_are(tmp_path) -> None:
    (tmp_path / "truth.csv").write_text("t_s,n0_x_m\n0,1\n1,1\n")
    assert isinstance(read_truth(tmp_path / "truth.csv", 3), StampedPositions)


def edited(row: int, column: int, value: str, delimiter: str = ","):
    """An edit of one cell, both counted from 1."""

    def edit(text: str) -> str:
        rows = [line.split(delimiter) for line in text.replace("\r", "").split("\n")]
        rows[row - 1][column - 1] = value
        return "\n".join(delimiter.join(cells) for cells in rows)

    return edit


def unstamped(text: str) -> str:
    """A file of Qualisys without rate, and without the columns Frame and Time."""
    lines = text.replace("FREQUENCY\t100", "FREQUENCY\tEXT").splitlines()
    return "\n".join([*lines[:11], *(line.split("\t", 2)[2] for line in lines[12:])])


def shortened(row: int, delimiter: str = ","):
    return lambda text: "\n".join(
        line.rpartition(delimiter)[0] if k == row - 1 else line
        for k, line in enumerate(text.replace("\r", "").split("\n"))
    )


@pytest.mark.parametrize(
    ("name", "edit", "message"),
    [
        ("take.csv", edited(1, 2, "1.1"), "row 1: Format Version: expected 1.2x, got '1.1'"),
        (
            "take.csv",
            lambda text: text.replace("Millimeters", "Feet"),
            "row 1: Length Units: expected a unit of length",
        ),
        (
            "take.csv",
            lambda text: text.replace("Global", "Local"),
            "row 1: Coordinate Space: expected Global, got 'Local'",
        ),
        ("take.csv", edited(8, 1, "Fr"), "no row: expected one that begins with Frame, Time (Seconds)"),
        ("take.csv", edited(10, 14, "left"), "row 10, column 14: expected a finite number, got 'left'"),
        ("take.csv", edited(10, 2, "0.0"), "row 10, column 2: expected more than 0.000000, got 0.0"),
        ("take.csv", edited(-1, 2, "1e9"), "expected frames at most 1 s apart, got "),  # of the last row
        ("take.csv", edited(10, 14, "1e9"), "expected a magnitude of at most 10000, got 1e+06: is the unit right?"),
        ("take.csv", shortened(11), "row 11: expected 25 cells, got 24"),
        (
            "take.csv",
            lambda text: text[: text.index("\r\n1,")] + "\r\n",
            "expected at least two rows of positions, got 1",
        ),
        ("vicon.csv", edited(2, 1, "fast"), "row 2: rate in Hz: expected a number above 0, got 'fast'"),
        ("vicon.csv", edited(4, 2, "X"), "row 4: expected Frame, Sub Frame, got Frame, X"),
        ("vicon.csv", edited(5, 3, "deg"), "row 5: units: expected a unit of length, m, meters"),
        ("vicon.csv", edited(7, 4, "inf"), "row 7, column 4: expected a finite number, got 'inf'"),
        ("vicon.csv", edited(7, 1, ""), "row 7, column 1: expected a finite number, got ''"),
        ("take.tsv", edited(3, 2, "9", "\t"), "NO_OF_MARKERS: expected 4 as in row 10, got 9"),
        ("take.tsv", unstamped, "FREQUENCY in Hz: expected a number above 0, got 'EXT'"),
        ("take.tsv", edited(10, 1, "BODY_NAMES", "\t"), "expected one that begins with MARKER_NAMES, as of 3D data"),
        ("take.tsv", edited(14, 3, "left", "\t"), "row 14, column 3: expected a finite number, got 'left'"),
        ("take.tsv", edited(14, 2, "0.0", "\t"), "row 14, column 2: expected more than 0.00000, got 0.0"),
        ("take.tsv", shortened(14, "\t"), "row 14: expected 14 cells, got 13"),
        (
            "take.trc",
            lambda text: text.replace("\t", ","),
            "row 1: expected tabs between cells, got 'PathFileType,4,(X/Y/Z),take.trc'",
        ),
        ("take.trc", edited(3, 5, "deg", "\t"), "row 3: Units: expected a unit of length"),
        ("take.trc", edited(3, 4, "9", "\t"), "row 3: NumMarkers: expected 4 as in row 4, got 9"),
        ("take.trc", edited(4, 2, "When", "\t"), "row 4: expected Frame#, Time, got Frame#, When"),
        ("take.trc", edited(8, 3, "x", "\t"), "row 8, column 3: expected a finite number, got 'x'"),
        ("take.trc", edited(8, 15, "5", "\t"), "row 8: expected 14 cells, got 15"),
    ],
)
def test_what_is_wrong_is_named(path_of, name, edit, message) -> None:
    path = path_of(name, edit)
    with pytest.raises(InputError) as error:
        read_truth(path, 4)
    assert str(error.value).startswith(str(path))
    assert message in str(error.value)


def test_what_is_wrong_with_c3d(path_of) -> None:
    path = path_of("take.c3d")
    whole = path.read_bytes()
    for content, message in ((b"text", "is no C3D file"), (whole[:600], "cannot be read as C3D")):
        path.write_bytes(content)
        with pytest.raises(InputError, match=message):
            read_truth(path, 4)


def test_a_c3d_file_that_was_cut_short_is_refused(path_of) -> None:
    path = path_of("take.c3d")
    data = (path.read_bytes()[16] - 1) * 512  # word 9 of the header, whose high byte is 0 here
    frame = 16 * len(TAKE.names)
    path.write_bytes(path.read_bytes()[: data + 3 * frame])
    told = rf"take\.c3d: cannot be read as C3D: expected the {len(TAKE.t_s)} frames of its header, got 3: was the copy"
    with pytest.raises(InputError, match=told):
        read_truth(path, 3)


def test_a_c3d_file_that_ends_its_reader_is_refused(path_of) -> None:
    """Labels of 255 dimensions are a segmentation fault in ezc3d."""
    path = path_of("take.c3d")
    content = bytearray(path.read_bytes())
    dimensions = content.index(b"LABELS") + 9
    content[dimensions : dimensions + 2] = b"\xff\xff"
    path.write_bytes(content)
    with pytest.raises(InputError, match="cannot be read as C3D: the reader was ended by signal 11"):
        read_truth(path, 4)


def test_the_reader_of_c3d_takes_no_more_memory_than_it_may() -> None:
    """A damaged file may ask for any number of frames."""
    folder = Path(c3d_file.__file__).parent
    code = "import c3d_points, numpy; c3d_points._limit_memory(); numpy.ones(1 << 30)"
    ended = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert "MemoryError" in ended.stderr


def test_c3d_without_its_library_says_what_to_install(path_of, monkeypatch) -> None:
    path = path_of("take.c3d")
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(InputError, match=r"take\.c3d: C3D needs ezc3d: pip install 'tensegraph\[mocap\]'"):
        read_truth(path, 4)


@pytest.mark.parametrize("name", ["none.csv", "none.c3d", "none.trc"])
def test_a_file_that_is_not_there(tmp_path, name) -> None:
    with pytest.raises(InputError, match=r"none\.\w+: no such file"):
        read_truth(tmp_path / name, 4)
