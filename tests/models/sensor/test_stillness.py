"""Whether a structure rests, from its sensors."""

import numpy as np
import pytest

import tensegraph
from tensegraph import open_trial
from tensegraph.models.sensor.stillness import StillnessWatch


@pytest.mark.parametrize("every", [1, 5, 10])
@pytest.mark.parametrize(("from_s", "still"), [(0.0, True), (2.8, False)])
def test_stillness(example, model, from_s: float, still: bool, every: int) -> None:
    """The example rests for two seconds, and is pressed after three; boards may send 50, 10 or 5 rows a second."""
    trial = open_trial(example)
    d, boards = trial.description, trial.description.boards(tensegraph.Settings().clock)
    watch = StillnessWatch(model.gauge, d.natural_resistance_ohm, d.structure.natural_length_m)
    for row in trial.readings():
        reading = boards.reading(row)
        if reading is not None and from_s <= row.host_s < from_s + 2 and row.seq % every == 0:
            watch.add(reading)
    motion = watch.motion()
    assert motion.still == still
    assert (motion.largest_m < 0.001) == still or every > 1


def test_too_few_readings_are_no_rest(example, model) -> None:
    """Three quarters of a second leave one whole block, which cannot be compared with anything."""
    d = open_trial(example).description
    watch = StillnessWatch(model.gauge, d.natural_resistance_ohm, d.structure.natural_length_m)
    none = np.zeros(24, dtype=np.int64)
    for k in range(37):
        reading = tensegraph.ResistanceReading(
            source=0,
            t_s=0.02 * k,
            arrival_s=0.02 * k,
            tendon=np.arange(24),
            resistance_ohm=d.natural_resistance_ohm,
            sigma_ohm=none,
            flags=none,
        )
        watch.add(reading)
    with pytest.raises(tensegraph.TensegraphError, match="expected at least 1 s"):
        watch.motion()


def test_a_bad_sensor_alone_does_not_move_the_structure(example, model) -> None:
    d = open_trial(example).description
    watch = StillnessWatch(model.gauge, d.natural_resistance_ohm, d.structure.natural_length_m)
    for k in range(100):
        resistance_ohm = d.natural_resistance_ohm.copy()
        resistance_ohm[7] *= 1 + 0.01 * k  # drifts away
        resistance_ohm[8] = np.nan
        none = np.zeros(24, dtype=np.int64)
        watch.add(tensegraph.ResistanceReading(0, 0.02 * k, 0.02 * k, np.arange(24), resistance_ohm, none, none))
    motion = watch.motion()
    assert motion.still
    assert motion.tendon == 7
    # 12.5 rows of 1 % from one average to the next, six averages inside, 24 mm of length for 10 % at this slope
    L0 = d.structure.natural_length_m[7]
    assert motion.largest_m == pytest.approx(5 * 0.125 * L0 / model.gauge.slope(np.zeros(1))[0], rel=0.05)
