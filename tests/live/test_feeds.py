"""Where live readings come from."""

import pytest
import tomli_w

import tensegraph
from tensegraph.live.feeds import replay_feed
from tensegraph.live.rig import Rig
from tensegraph.models.sensor.clock import ClockSettings
from tensegraph.models.values.link import LinkState
from trial_edits import stamped


def test_a_rig_without_boards_is_refused(rig) -> None:
    text = rig.read_text()
    rig.write_text(text[: text.index("[[board]]")] + '[lengths]\nfile = "lengths.csv"\n')
    with pytest.raises(tensegraph.InputError, match=r"rig has boards: expected \[\[board\]\], got \[lengths\]"):
        Rig.read(rig)


def test_a_rest_too_short_to_judge_is_refused(rig) -> None:
    rig.write_text(rig.read_text().replace("seconds = 2.0", "seconds = 0.5"))
    with pytest.raises(
        tensegraph.InputError, match=r"\[rest\] seconds: too short .*: expected 0 or at least 1, got 0.5"
    ):
        Rig.read(rig)


IMU = "\n[[imu]]\nrod = 0\naxis = [0, 0, 1]\n"
NOT_FROM_BOARDS = {
    "imu[0].board: is missing: a rig reads its inertial sensors from boards": IMU + 'file = "imu0.csv"\n',
    "[[range]]: comes from no board": '\n[[range]]\nfile = "r.csv"\nbeacon_position_m = [[0, 0, 2]]\n',
    "[[position]]: comes from no board": '\n[[position]]\nfile = "p.csv"\n',
    "[[motor]]: comes from no board": '\n[[motor]]\nfile = "l.csv"\ntendons = [3]\nstrip_length_m = 0.1\n',
}


@pytest.mark.parametrize("message", NOT_FROM_BOARDS)
def test_what_no_board_can_read_is_refused(rig, message) -> None:
    rig.write_text(rig.read_text() + NOT_FROM_BOARDS[message])
    with pytest.raises(tensegraph.InputError) as refused:
        Rig.read(rig)
    assert message in str(refused.value)


def test_a_rig_s_sensors_are_told_by_board_and_number(rig) -> None:
    """And a recording's trial.toml is a rig again."""
    rig.write_text(rig.read_text() + IMU + "board = 1\nsensor = 2\n" + IMU + 'board = 0\nfile = "hand.csv"\n')
    described = Rig.read(rig)
    assert described.plan((), ClockSettings()).imus == ((1, 2), (0, 0))
    recorded = described.metadata("first", LinkState())
    assert [table["file"] for table in recorded["imu"]] == ["imu0.csv", "hand.csv"]
    rig.write_text(tomli_w.dumps(recorded))
    assert Rig.read(rig).plan((), ClockSettings()).imus == ((1, 2), (0, 0))


def test_the_seconds_of_a_replay_count_from_its_first_reading(trial_copy) -> None:
    """The example, and the same whose host's clock started a day before: one second of rows at 50 Hz of two boards."""
    a_day_later = stamped(lambda host_s: host_s + 86_400)
    later = trial_copy(name="later", board0=a_day_later, board1=a_day_later)
    for path in (trial_copy(), later):
        with replay_feed(path, 1e6, None, seconds=1.0) as feed:
            host_s = [reading.host_s for reading in feed.rows]
        assert len(host_s) == pytest.approx(100, abs=4)
        assert host_s[-1] - host_s[0] <= 1.0


def test_files_that_are_refused_leave_no_recording(trial_copy, tmp_path) -> None:
    """The header of a board has another name for a column."""
    trial = trial_copy(board1=lambda text: text.replace("adc8", "adcx", 1))
    with (
        pytest.raises(tensegraph.InputError, match=r"column .adc8. is missing"),
        replay_feed(trial, 1e6, tmp_path / "again"),
    ):
        raise AssertionError("the feed began")
    assert not (tmp_path / "again").exists()


@pytest.mark.parametrize("row", [3, 60])
def test_a_refusal_on_the_way_leaves_no_half_of_a_recording(trial_copy, tmp_path, row) -> None:
    """A cell of a board is damaged: what came before it is in the trial, and would look like all of another one."""

    def damaged(text: str) -> str:
        rows = text.splitlines(keepends=True)
        rows[row] = rows[row].replace(",", ",x", 1)
        return "".join(rows)

    trial = trial_copy(board1=damaged)
    with (
        pytest.raises(tensegraph.InputError, match=rf"board1.csv: row {row + 1}, column seq: expected a finite number"),
        replay_feed(trial, 1e6, tmp_path / "again") as feed,
    ):
        list(feed.rows)
    assert not (tmp_path / "again").exists()


def test_what_was_recorded_whole_stays(trial_copy, tmp_path) -> None:
    """Also where the result cannot be written then."""
    rows = []

    def session() -> None:
        with replay_feed(trial_copy(), 1e6, tmp_path / "again") as feed:
            rows.extend(feed.rows)
            raise tensegraph.InputError("out: cannot be written: the disk is full")

    with pytest.raises(tensegraph.InputError, match="the disk is full"):
        session()
    assert len(list(tensegraph.open_trial(tmp_path / "again").readings())) == len(rows)
