"""A board that runs the real firmware, emulated."""

import signal
import subprocess
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


class EmulatedBoard:
    """A Mega that runs the firmware, its pins at the voltages that gave a trial's codes; on a pty of its own.

    The trial's two seconds of rest come several times over, so that there is time to tare on them. With samples, an
    inertial sensor is on its bus: (rows, 8) of t_s, three accelerations, a temperature and three rates, in digits. At
    its start the registers of power, of the range of rates and of that of forces have values of its own.
    """

    def __init__(
        self,
        firmware: Path,
        number: int,
        trial: Path,
        folder: Path,
        rate_ppm: float = 0.0,
        rests: int = 1,
        samples: NDArray[np.float64] | None = None,
        at_start: tuple[int, int, int] = (0x40, 0, 0),
    ) -> None:
        self.port = folder / f"board{number}"
        self.log = folder / f"board{number}.log"
        kind = "board" if samples is None else "imu"
        self._command = [firmware / "board", firmware / f"{kind}{number}.elf", self.port, folder / f"mv{number}.csv"]
        self._command += [rate_ppm, folder / f"board{number}.eeprom", self.log]
        if samples is not None:
            self._command += [folder / f"samples{number}.csv", *at_start]
            np.savetxt(self._command[-4], samples, delimiter=",", fmt="%.4f")
        rows = np.loadtxt(trial / f"board{number}.csv", delimiter=",", skiprows=1)
        resting = rows[rows[:, 0] < 2.0]
        rows = np.concatenate([*[resting] * (rests - 1), rows])
        millivolt = (rows[:, 3:] + 0.5) * 5000 / 1024
        np.savetxt(
            self._command[3], np.column_stack([0.02 * np.arange(len(rows)), millivolt]), delimiter=",", fmt="%.4f"
        )
        self._process: subprocess.Popen[bytes] | None = None

    def plug(self) -> None:
        """Start, and wait for the port."""
        self._process = subprocess.Popen([str(part) for part in self._command], stdout=subprocess.DEVNULL)
        while not self.port.is_symlink():
            assert self._process.poll() is None
            time.sleep(0.01)

    def plug_sensor(self) -> None:
        """Take the inertial sensor off the bus, or put it back."""
        assert self._process is not None
        self._process.send_signal(signal.SIGUSR1)

    def unplug(self) -> None:
        """Stop: the port goes, the boot counter stays."""
        if self._process is not None:
            self._process.terminate()
            self._process.wait(10)
            self._process = None
