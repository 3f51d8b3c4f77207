"""The loop on trials that are not as they should be, and on other sources than boards."""

from dataclasses import replace
from itertools import islice, takewhile
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from pipelines import pipeline_of
from roll import soon_tipped
from tensegraph import Flag, InputError, Reconstruction, Settings, Status, open_trial
from tensegraph.factors.tendon import TautCables
from tensegraph.models.evaluation.metrics import node_rmse_m
from tensegraph.models.sensor.frames import FrameSettings
from tensegraph.models.structure.shape import Reason
from tensegraph.models.trial_description import TrialDescription
from tensegraph.pipeline import estimator_of, reconstruct, stream
from told_rows import rows_of
from trial_edits import cell, lines, rewritten, stamped

EXAMPLES = Path(__file__).parents[1] / "examples"
UNTIL_TIPPED_S = 3.0
"""When the robot that is tipped soon has gone over its first edge, and lies still."""


@pytest.fixture(scope="module")
def plain(example) -> Reconstruction:
    """The first three seconds of the example as they are, live: a frame does not depend on what comes later."""
    trial = open_trial(example)
    readings = takewhile(lambda row: row.host_s < 3.0, trial.readings())
    return Reconstruction.of(trial.description.structure, stream(readings, trial.description))


@pytest.mark.parametrize("method", ["batch", "live", "frame"])
def test_a_trial_of_one_row_a_board_is_one_frame(trial_copy, method) -> None:
    result = reconstruct(trial_copy(rows=1), method)
    assert 1 <= len(result) <= 3
    assert np.isfinite(result.node_position_m).all()


def test_one_board_alone_is_enough(trial_copy) -> None:
    path = trial_copy(rows=60)
    header = (path / "board1.csv").read_text().splitlines()[0]
    (path / "board1.csv").write_text(header + "\n")
    result = reconstruct(path, "live")
    assert (result.flags[:, 12:] & Flag.MISSING).all()
    assert not (result.flags[5:, :12] & Flag.MISSING).any()


@pytest.mark.parametrize(
    ("every", "least", "most", "text"),
    [
        (1, 0.0, 0.05, None),
        (4, 0.0, 0.05, "a row each 0.08 s: 12.5 frames a second, and not 50"),
        (8, 0.0, 0.05, "a row each 0.16 s: 10 frames a second, and not 50"),
        (16, 0.6, 0.8, "a row each 0.32 s: frames between them have no reading: send them faster"),
    ],
)
def test_a_slow_board_is_named(trial_copy, every, least, most, text) -> None:
    """Sketches of 12.5 and 6.25 rows a second have as few frames, but 10 at least; those of 3 leave gaps."""

    def thinned(rows):
        cells = [row.split(",", 2) for row in rows[1::every]]
        return [rows[0], *(f"{host_s},{number},{others}" for number, (host_s, _, others) in enumerate(cells))]

    trial = open_trial(trial_copy(rows=200, board0=lines(thinned)))
    pipeline = pipeline_of(trial.description)
    frames = list(pipeline.lengths(trial.readings()))
    assert least <= np.mean([np.isnan(frame.length_m[:12]).all() for frame in frames]) < most
    assert pipeline.warnings() == ({"board 0": text} if text else {})


def test_a_robot_that_rolls_keeps_its_frames_at_slow_boards(tmp_path) -> None:
    """Boards of 10 rows a second: between two of them it may turn by a radian, which inertial sensors follow."""
    path = soon_tipped(tmp_path / "roll", UNTIL_TIPPED_S)
    for board in path.glob("board*.csv"):
        rewritten(board, lines(lambda rows: rows[:1] + rows[1::5]))
    trial = open_trial(path)
    pipeline = pipeline_of(trial.description)
    shapes = Reconstruction.of(trial.description.structure, pipeline.estimate(trial.readings(), "live"))
    assert np.median(np.diff(shapes.t_s)) == pytest.approx(0.02)
    assert not pipeline.warnings()
    assert node_rmse_m(shapes, trial.truth().t_s, trial.truth().node_position_m) < 0.02


def test_a_robot_that_rolls_has_frames_between_slow_rows_of_lengths(tmp_path) -> None:
    """Ten rows a second with 0.5 mm of noise: without such frames, another trial was 2.9 m off after a tip."""
    path = soon_tipped(tmp_path / "roll", UNTIL_TIPPED_S)
    trial = open_trial(path)
    truth, structure = trial.truth(), trial.description.structure
    every = slice(0, None, round(0.1 / np.diff(truth.t_s).mean()))
    t_s, x = truth.t_s[every], truth.node_position_m[every]
    length_m = structure.tendon_length_m(x) + np.random.default_rng(3).normal(0, 5e-4, (len(x), len(structure.tendons)))
    columns = ",".join(["t_s", *(f"l{tendon}_m" for tendon in range(length_m.shape[1]))])
    np.savetxt(path / "lengths.csv", np.column_stack([t_s, length_m]), "%.6f", ",", header=columns, comments="")
    toml = tomlkit.parse((path / "trial.toml").read_text())
    for table in ("board", "adc", "sensors"):
        del toml[table]
    toml["lengths"] = {"file": "lengths.csv", "strips": False}
    (path / "trial.toml").write_text(tomlkit.dumps(toml))
    shapes = reconstruct(path, "live")
    assert np.diff(shapes.t_s).max() < 0.03
    assert node_rmse_m(shapes, truth.t_s, truth.node_position_m) < 0.02


def test_a_board_that_counts_past_its_end_goes_on(trial_copy, plain) -> None:
    """16-bit rows and 32-bit microseconds wrap in the middle; the result is the same to the microsecond."""

    def shifted(rows):
        out = rows[:1]
        for row in rows[1:]:
            host_s, seq, device_us, *codes = row.split(",")
            out.append(
                ",".join(
                    [
                        host_s,
                        str((int(seq) + 65_500) % 2**16),
                        str((int(device_us) + 2**32 - 4_300_000) % 2**32),
                        *codes,
                    ]
                )
            )
        return out

    wrapped = reconstruct(trial_copy(board0=lines(shifted)), "live")
    before = len(wrapped) - 4  # of the last frames, rows of one board may be cut off
    assert before > 115
    np.testing.assert_allclose(wrapped.node_position_m[:before], plain.node_position_m[:before], atol=1e-6)


def test_rows_out_of_order_are_dropped_and_counted(trial_copy) -> None:
    path = trial_copy(board0=lines(lambda rows: [*rows[:50], rows[51], rows[50], *rows[52:]]))
    trial = open_trial(path)
    pipeline = pipeline_of(trial.description)
    frames = list(pipeline.lengths(trial.readings()))
    assert pipeline.boards.counts[0].dropped_rows == 1
    assert len(frames) > 100


@pytest.mark.parametrize("name", ["press_01", "roll_02"])
def test_many_frames_at_a_time_give_the_same_lengths(name) -> None:
    """Of boards alone, and with an inertial sensor, whose samples stay with their frame."""
    trial = open_trial(EXAMPLES / name)
    one_by_one = pipeline_of(trial.description).lengths(islice(trial.readings(), 800))
    many = pipeline_of(trial.description).lengths(islice(trial.readings(), 800), 150)
    for one, other in zip(one_by_one, many, strict=True):
        assert one.t_s == other.t_s
        np.testing.assert_allclose(one.length_m, other.length_m, atol=1e-12)
        np.testing.assert_allclose(one.sigma_m, other.sigma_m, atol=1e-12)
        np.testing.assert_array_equal(one.flags, other.flags)
        assert [aid.t_s for aid in one.aids] == [aid.t_s for aid in other.aids]


def test_absurd_codes_are_left_out_and_named(trial_copy) -> None:
    path = trial_copy(
        board0=lines(
            lambda rows: [cell(1, 6, row.split(",")[6] if k == 0 else "-7")(row) for k, row in enumerate(rows)]
        )
    )
    result = reconstruct(path, "live")
    assert (result.flags[:, 3] & Flag.MISSING).all()
    assert (result.flags[:-1, 3] & Flag.OUT_OF_RANGE).all()
    assert np.isfinite(result.node_position_m).all()


def test_an_open_circuit_and_a_spike_are_named_and_do_not_stop(trial_copy) -> None:
    def broken(rows):
        for k in range(60, len(rows)):
            rows[k] = cell(1, 8, "1023")(rows[k])
        rows[40] = cell(1, 4, "900")(rows[40])
        return rows

    result = reconstruct(trial_copy(board1=lines(broken)), "live")
    assert result.flags[100, 17] & Flag.SATURATED
    assert result.flags[100, 17] & Flag.MISSING
    assert (result.flags[:, 13] & Flag.OUTLIER).any()
    assert not (result.flags[:, 13] & Flag.MISSING).any()
    assert result.status[100] == "partial"


@pytest.fixture(scope="module")
def told(example) -> TrialDescription:
    """The example, described as a trial whose lengths are told."""
    return replace(open_trial(example).description, source="lengths", natural_resistance_ohm=np.empty(0))


def as_resistance(path, trial) -> None:
    """Rewrite a trial of counts as one of resistance."""
    pipeline = pipeline_of(trial.description)
    readings = [pipeline.boards.reading(row) for row in trial.readings()]
    both = {}
    for reading in readings:
        both.setdefault(round(reading.t_s * 50), np.full(24, np.nan))[reading.tendon] = reading.resistance_ohm
    header = ",".join(["t_s", *(f"r{e}_ohm" for e in range(24))])
    rows = [",".join([f"{k / 50:.3f}", *(f"{v:.0f}" if v == v else "" for v in both[k])]) for k in sorted(both)]
    (path / "resistance.csv").write_text("\n".join([header, *rows, ""]))
    text = (path / "trial.toml").read_text()
    text = text[: text.index("[[board]]")] + '[resistance]\nfile = "resistance.csv"\n'
    (path / "trial.toml").write_text(text)


def test_resistance_stands_in_for_counts(trial_copy, plain) -> None:
    path = trial_copy(rows=150)
    as_resistance(path, open_trial(path))
    resistance = reconstruct(path, "live")
    last = slice(len(resistance) - 20, len(resistance))
    error = np.abs(resistance.node_position_m[last].mean(axis=0) - plain.node_position_m[last].mean(axis=0))
    assert error.max() < 0.003


def test_resistances_with_stamps_in_milliseconds_are_refused(trial_copy) -> None:
    """Each row would be followed by a thousand frames without a reading."""
    path = trial_copy(rows=30)
    as_resistance(path, open_trial(path))
    rewritten(path / "resistance.csv", stamped(lambda t_s: 1e3 * t_s))
    with pytest.raises(InputError, match=r"resistance\.csv: column t_s: .* at most 0\.5 s apart, got 20 s "):
        reconstruct(path, "live")


def test_lengths_stand_in_for_counts(trial_copy, plain) -> None:
    path = trial_copy(rows=150)
    header = ",".join(["t_s", *(f"l{e}_m" for e in range(24)), *(f"s{e}_m" for e in range(24))])
    rows = [
        ",".join(repr(float(value)) for value in (t, *length, *sigma))
        for t, length, sigma in zip(plain.t_s, plain.length_m, plain.sigma_m, strict=True)
    ]
    (path / "lengths.csv").write_text("\n".join([header, *rows, ""]))
    text = (path / "trial.toml").read_text()
    (path / "trial.toml").write_text(text[: text.index("[adc]")] + '[lengths]\nfile = "lengths.csv"\n')
    lengths = reconstruct(path, "live")
    # what part of sigma is the rest shape's is not in the file, so weights differ a little; nor is the sensors' lag
    before_a_press = plain.t_s < 2.7
    np.testing.assert_allclose(
        lengths.node_position_m[before_a_press], plain.node_position_m[before_a_press], atol=0.0015
    )
    assert not any(lengths.doubts)
    (path / "lengths.csv").write_text(
        "\n".join([header.replace("l0_m,", "").replace("l23_m", "l23_m,l0_m"), *rows[:110], ""])
    )
    assert all(doubt is not None for doubt in reconstruct(path, "live").doubts[20:])  # each tendon has its neighbour's


@pytest.mark.parametrize(("told_m", "flag"), [(0.8, Flag.OUT_OF_RANGE), (0.3, Flag.OUTLIER)])
@pytest.mark.parametrize("method", ["live", "frame"])
def test_a_length_that_jumps_is_left_out(plain, told, method, told_m, flag) -> None:
    """One wrong cell of a file, of a tendon of 0.17 m; the next reading is believed again."""
    read = rows_of(plain.length_m, t_s=plain.t_s)
    wrong_m = np.where(np.arange(24) == 6, told_m, read[60].length_m)
    with_jump = [*read[:60], replace(read[60], length_m=wrong_m), *read[61:70]]
    shapes, others = list(stream(with_jump, told, method)), list(stream(read[:70], told, method))
    assert [k for k, shape in enumerate(shapes) if shape.lengths.flags[6] & flag] == [60]
    assert shapes[60].status is Status.PARTIAL
    for shape, other in zip(shapes, others, strict=True):
        np.testing.assert_allclose(shape.node_position_m, other.node_position_m, atol=0.003)


def test_a_wound_cable_with_a_short_natural_length_may_move_as_fast_as_others(plain, told) -> None:
    """A length of 0.17 m that changes by 10 mm in a frame, whose natural length is told as 0.02 m."""
    wound_m = np.where(np.arange(24) == 6, 0.02, told.structure.natural_length_m)
    trial = replace(told, mechanics=None, structure=replace(told.structure, natural_length_m=wound_m))
    shorter_m = plain.length_m[0] - 0.01 * (np.arange(24) == 6)
    read = rows_of([plain.length_m[0], plain.length_m[0], shorter_m, shorter_m], 0.0003)
    assert not any(shape.lengths.flags.any() for shape in stream(read, trial, "frame"))


@pytest.mark.parametrize("method", ["live", "batch"])
def test_two_columns_of_lengths_that_are_exchanged_are_in_doubt(plain, told, method) -> None:
    """Two lengths that differ by millimetres at rest, each told as the other; one alone that is wrong is none."""
    read = rows_of(plain.length_m, plain.sigma_m, plain.t_s)[:80]
    columns = np.arange(24)
    columns[[4, 20]] = 20, 4
    apart_m = np.diff(np.mean([one.length_m[[4, 20]] for one in read], axis=0))[0]
    assert abs(apart_m) > 0.002
    exchanged = [replace(one, length_m=one.length_m[columns]) for one in read]
    alone = [replace(one, length_m=one.length_m + apart_m * (np.arange(24) == 4)) for one in read]
    doubted = [
        [shape.doubt is Reason.REST for shape in stream(rows, told, method)] for rows in (exchanged, alone, read)
    ]
    assert all(doubted[0][20:])
    assert not any(doubted[1] + doubted[2])


@pytest.mark.parametrize(("moved_m", "expected"), [(0.0, False), (0.012, True)])
def test_anchors_that_are_not_where_lengths_between_them_say_are_in_doubt(moved_m, expected, plain, told) -> None:
    """One anchor 12 mm away: two of the three lengths between anchors contradict it; forces are not known.

    Where the structure rests at the start, its lengths tell where the anchors are.
    """
    anchors_m = told.structure.anchor_position_m + moved_m * (np.arange(3)[:, None] == 1) * np.array([1.0, 0, 0])
    structure = replace(told.structure, anchor_position_m=anchors_m)
    trial = replace(told, structure=structure, mechanics=None, rest_position_m=None)
    true_m = told.structure.tendon_length_m(plain.node_position_m[0])
    noise_m = 0.001 * np.random.default_rng(1).standard_normal((10, 24))
    read = rows_of(true_m + noise_m, 0.001)
    resting = pipeline_of(trial)
    assert not any(shape.doubt for shape in resting.shapes(read, "frame"))
    assert (resting.rest.wrong == ("anchors",)) is expected
    moving = replace(trial, rest_seconds=0.0)
    assert all((shape.doubt is Reason.GEOMETRY) is expected for shape in stream(read, moving, "frame"))


def test_what_was_watched_in_one_run_is_nothing_to_the_next(plain, told) -> None:
    """The lengths of a run, whose rest is another shape, and then right ones, by the same pipeline."""
    pipeline = pipeline_of(told)
    read = rows_of(plain.predicted_m, 0.001, plain.t_s)[:20]
    others = [replace(one, length_m=one.length_m[::-1]) for one in read]
    in_doubt = [
        all(shape.doubt is Reason.REST for shape in pipeline.shapes(run, "frame")) for run in (others, read, others)
    ]
    assert in_doubt == [True, False, True]


@pytest.mark.parametrize("method", ["live", "batch", "frame"])
def test_lengths_at_rest_tell_a_rest_shape_that_nobody_measured(method, told, example) -> None:
    """The true lengths, which nothing loads at rest; found from forces alone, the rest shape shows loads of 1 N."""
    trial = replace(told, rest_position_m=None, rest_seconds=1.0)
    truth = open_trial(example).truth()
    read = rows_of(trial.structure.tendon_length_m(truth.node_position_m), 0.0005, truth.t_s)[:65]
    pipeline = pipeline_of(trial)
    shapes = Reconstruction.of(trial.structure, pipeline.shapes(read, method))
    assert (pipeline.rest.source, pipeline.rest.wrong) == ("lengths", ())
    np.testing.assert_allclose(shapes.node_position_m, truth.node_position_m[:65], atol=0.0015)
    assert np.nanmax(np.abs(shapes.loads.force_n)) < 0.15
    assert set(shapes.status) == {Status.OK}
    longer = [replace(one, length_m=one.length_m + 0.012) for one in read]
    assert all(shape.status is Status.DOUBT for shape in pipeline.shapes(longer, method))
    assert pipeline.rest.source == "found"
    assert pipeline.misfits_at_rest


def test_lengths_that_are_told_again_and_again_are_in_doubt(plain, told) -> None:
    """A program that goes on to send its last row: every length is as plausible as before."""
    read = rows_of(plain.length_m, plain.sigma_m, plain.t_s)
    again = [replace(read[-1], t_s=read[-1].t_s + 0.02 * k) for k in range(1, 61)]
    shapes = list(stream([*read, *again], told))
    assert not any(shape.doubt for shape in shapes[: len(read) + 48])
    assert all(shape.doubt == Reason.SENSORS for shape in shapes[-9:])


@pytest.mark.parametrize("method", ["live", "frame", "least-squares", "ukf"])
def test_a_length_that_is_wrong_from_the_rest_on_is_left_out_or_in_doubt(method, plain, told) -> None:
    """The live estimate leaves it out; the others use it."""
    off_m = np.where(np.arange(24) == 20, 0.05, 0.0)
    shapes = list(stream(rows_of(plain.length_m + off_m, plain.sigma_m, plain.t_s), told, method))[50:]
    assert not any(shape.lengths.usable[20] and shape.status is Status.OK for shape in shapes)
    if method != "live":
        assert {shape.doubt for shape in shapes} == {Reason.SENSORS}


def test_the_rest_is_read_once_for_several_methods(plain, told) -> None:
    """As `compare` does it: the frames after the rest are given to one method after the other."""
    pipeline = pipeline_of(replace(told, rest_position_m=None))
    read = rows_of(plain.length_m, plain.sigma_m, plain.t_s)
    whole = Reconstruction.of(told.structure, pipeline.shapes(read, "frame"))
    frames = list(pipeline.after_rest(read))
    rest = pipeline.rest
    again = Reconstruction.of(told.structure, pipeline.shapes_by(estimator_of("frame"), "frame", frames))
    np.testing.assert_array_equal(again.node_position_m, whole.node_position_m)
    assert pipeline.rest is rest


def test_factors_of_a_frame_stand_beside_those_of_its_trial(plain, told) -> None:
    """Those of stiff cables: the trial's replaced the frame's, about which nothing was said."""

    class Tape:
        def rows(self, t_s, node_position_m):
            raise NotImplementedError

    tape = Tape()
    cables = replace(told.mechanics, stiff_cables=np.array([9]))
    pipeline = pipeline_of(replace(told, mechanics=cables))
    read = [replace(one, factors=(tape,)) for one in rows_of(plain.length_m)[:3]]
    for frame in pipeline.lengths(read):
        assert frame.factors == (*pipeline.factors, tape)
    assert [type(factor) for factor in pipeline.factors] == [TautCables]


@pytest.mark.parametrize("rate_hz", [2.0, 200.0])
def test_a_rate_of_frames_that_the_sensor_model_was_not_trained_at_is_refused(example, told, rate_hz: float) -> None:
    settings = replace(Settings(), frames=FrameSettings(rate_hz=rate_hz))
    trial = open_trial(example).description
    with pytest.raises(InputError, match=rf"frames\.rate_hz: expected 10 to 100, .*, got {rate_hz:g}$"):
        list(stream([], trial, settings=settings))
    assert not list(stream([], told, settings=settings))


def test_readings_that_are_not_of_the_rest_shape_are_in_doubt(trial_copy) -> None:
    """A converter of 12 bits that has 10: all resistances are as wrong."""
    path = trial_copy(rows=100, trial=lambda text: text.replace("bits = 10", "bits = 12"))
    result = reconstruct(path, "live")
    assert all(status == Status.DOUBT for status in result.status)
    assert Reason.REST in result.doubts


def test_doubt_about_the_rest_is_that_of_its_time(trial_copy) -> None:
    """Codes of one board jump at 1 s of the rest: live, offline as well, not before that; in batch from the start."""

    def jumped(rows):
        cells = [row.rstrip("\n").split(",") for row in rows[1:]]
        moved = [[*each[:3], *(str(int(code) + 12) for code in each[3:])] for each in cells[50:95]]
        return [rows[0], *(",".join(each) + "\n" for each in [*cells[:50], *moved, *cells[95:]])]

    trial = open_trial(trial_copy(rows=115, board0=lines(jumped)))
    streamed = list(stream(trial.readings(), trial.description))
    in_doubt = [shape.status is Status.DOUBT for shape in streamed]
    assert not any(in_doubt[:45])
    assert all(in_doubt[100:])
    assert list(reconstruct(trial, "live").status) == [shape.status for shape in streamed]
    assert all(status == Status.DOUBT for status in reconstruct(trial, "batch").status)


def test_lengths_in_place_of_readings_of_boards(example) -> None:
    """A length without sigma has that of the settings, a missing one none, whatever the trial is told to have."""
    description = open_trial(example).description
    length_m = description.structure.tendon_length_m(description.rest_position_m)
    length_m[12] = np.nan
    *_, last = stream(rows_of([length_m] * 10), description)
    assert last.status is Status.PARTIAL
    sigma_m = np.where(np.arange(24) == 12, np.inf, Settings().noise.unstated_m)
    np.testing.assert_array_equal(last.lengths.sigma_m, sigma_m)


def test_lengths_with_few_sigmas_with_gaps_and_with_stamps_that_go_back(trial_copy) -> None:
    path = trial_copy(rows=5)
    header = ",".join(["t_s", *(f"l{e}_m" for e in range(24)), "s3_m"])
    good = ",".join(["0.184"] * 24)
    rows = [
        f"0.00,{good},",
        f"0.02,{good.replace('0.184', '', 1)},0.001",
        f"0.01,{good},",
        f"0.05,{good.replace('0.184', '-1', 1)},4e-7",
    ]
    (path / "lengths.csv").write_text("\n".join([header, *rows, ""]))
    text = (path / "trial.toml").read_text()
    (path / "trial.toml").write_text(text[: text.index("[adc]")] + '[lengths]\nfile = "lengths.csv"\n')
    trial = open_trial(path)
    assert all(frame.of_strips for frame in trial.readings())
    result = reconstruct(trial, "live")
    (path / "trial.toml").write_text(text[: text.index("[adc]")] + '[lengths]\nfile = "lengths.csv"\nstrips = false\n')
    assert not any(frame.of_strips for frame in open_trial(path).readings())
    assert result.t_s.tolist() == [0.0, 0.02, 0.05]
    assert trial.dropped_rows == 1
    assert result.flags[:, 0].tolist() == [0, Flag.MISSING, Flag.OUT_OF_RANGE]
    assert result.flags[:, 3].tolist() == [0, 0, Flag.OUT_OF_RANGE]
    np.testing.assert_allclose(result.sigma_m[0], Settings().noise.unstated_m)


def test_truth_never_reaches_the_estimate(trial_copy) -> None:
    with_truth = trial_copy(rows=60)
    without = trial_copy(rows=60, name="blind", trial=lambda text: text[: text.index("[truth]")])
    (without / "truth.csv").unlink()
    (without / "loads.csv").unlink()
    for method in ("batch", "live"):
        a, b = reconstruct(with_truth, method), reconstruct(without, method)
        np.testing.assert_array_equal(a.node_position_m, b.node_position_m)
        np.testing.assert_array_equal(a.covariance_m2, b.covariance_m2)
    assert open_trial(with_truth).hashes() == open_trial(without).hashes()


class TestReferenceStrips:
    """Dummy strips on spare channels: those of the anchored tendons serve, whose lengths do not change either."""

    def test_they_show_the_drift_and_are_no_tendons(self, trial_copy, plain) -> None:
        strips = trial_copy(
            rows=150,
            name="strips",
            trial=lambda text: text.replace("[0, 1, 2,", '["reference", "reference", "reference",'),
        )
        found = reconstruct(strips, "live")
        count = min(len(found), len(plain)) - 4  # of the last frames, rows of one board may be cut off
        wired_m, wired_drift = plain.node_position_m[:count], plain.drift[:count]
        assert np.isnan(found.length_m[:, :3]).all()
        np.testing.assert_allclose(found.drift[:count, 5], wired_drift[:, 5], atol=2e-4)
        np.testing.assert_allclose(found.node_position_m[:count], wired_m, atol=5e-4)

    def test_another_word_is_refused(self, trial_copy) -> None:
        trial = trial_copy(trial=lambda text: text.replace("[0, 1, 2,", '["dummy", 1, 2,'))
        with pytest.raises(InputError, match="or 'reference', got 'dummy'"):
            reconstruct(trial)


@pytest.mark.parametrize("method", ["frame", "least-squares"])
def test_geometry_that_contradicts_the_forces_at_rest_is_doubted_by_every_method(trial_copy, method) -> None:
    """Live and batch doubt it themselves; the other methods know no doubt of their own."""
    trial = open_trial(trial_copy(rows=100))
    pipeline = pipeline_of(trial.description)
    pipeline.rest = replace(pipeline.rest, wrong=("hubs",))
    shapes = list(pipeline.estimate(trial.readings(), method))
    assert {shape.doubt for shape in shapes} == {Reason.GEOMETRY}
    assert {shape.status for shape in shapes} == {Status.DOUBT}
