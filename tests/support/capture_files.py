"""Motion capture of the example trial, and its files as the programs of captures write them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

OFFSET_S, RATE_PPM = 1.37, 80.0
"""Host time is capture time + 1.37 s at capture time zero, and runs faster by 80 ppm."""


@dataclass(frozen=True)
class Take:
    """What a capture saw: markers of some nodes in any order, then ghosts; Y up, in millimetres."""

    t_s: np.ndarray
    names: list[str]
    position_mm: np.ndarray
    node: np.ndarray

    def cells(self, k: int) -> list[str]:
        return ["" if np.isnan(x) else f"{x:.4f}" for x in self.position_mm[k].ravel()]


def take_of(t_s, node_m, nodes, *, ghosts=1, gaps=3, noise_mm=0.2, rate_hz=100.0, seed=1) -> Take:
    """Markers at some nodes of a motion on the host's clock, each hidden a few times for 0.4 s."""
    rng = np.random.default_rng(seed)
    capture_s = np.arange(0, (t_s[-1] - OFFSET_S) / (1 + 1e-6 * RATE_PPM), 1 / rate_hz)
    host_s = OFFSET_S + capture_s * (1 + 1e-6 * RATE_PPM)
    x, y, z = np.moveaxis(CubicSpline(t_s, node_m)(host_s)[:, nodes], -1, 0)
    position_mm = 1e3 * np.stack([x + 0.4, z + 0.1, 0.7 - y], axis=-1)  # x forward, y up, z right
    position_mm += noise_mm * rng.standard_normal(position_mm.shape)
    for marker in range(len(nodes)):
        for start in rng.integers(0, len(host_s) - 40, gaps):
            position_mm[start : start + 40, marker] = np.nan
    ghost_mm = position_mm[0, :1] * 0 + np.array([[250.0, 900.0, 300.0]]) + 70.0 * np.arange(ghosts)[:, None]
    position_mm = np.concatenate([position_mm, np.broadcast_to(ghost_mm, (len(host_s), ghosts, 3))], axis=1)
    names = [f"Unlabeled {1000 + k}" for k in range(len(nodes) + ghosts)]
    return Take(capture_s, names, position_mm, np.asarray(nodes))


def motive_text(take: Take) -> str:
    """Version 1.25, with a rigid body whose expected markers stand beside the measured ones."""
    head = (
        "Format Version,1.25,Take Name,press,Take Notes,,Capture Frame Rate,100.000000,Export Frame Rate,100.000000,"
        "Capture Start Time,2026-05-04 03.25.39.000 PM,Capture Start Frame,0,"
        f"Total Frames in Take,{len(take.t_s)},Total Exported Frames,{len(take.t_s)},"
        "Rotation Type,Quaternion,Length Units,Millimeters,Coordinate Space,Global"
    )
    kinds = ["Rigid Body"] * 8 + ["Rigid Body Marker"] * 3 + ["Marker"] * 3 * len(take.names)
    names = ["Base"] * 8 + [take.names[0]] * 3 + [name for name in take.names for _ in range(3)]
    what = ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"] + ["Position"] * 3 * (1 + len(take.names))
    axes = ["X", "Y", "Z", "W", "X", "Y", "Z", ""] + ["X", "Y", "Z"] * (1 + len(take.names))
    body = ["0", "0", "0", "1", "3000", "0", "0", "0.1", "1", "2", "3"]
    lines = [head, "", *(",".join(row) for row in (["", "Type", *kinds], ["", "Name", *names]))]
    lines += [",".join(["", "ID", *["7:1F"] * len(kinds)]), ",".join(["", "Parent", *[""] * len(kinds)])]
    lines += [",".join(["", "", *what]), ",".join(["Frame", "Time (Seconds)", *axes])]
    rows = [",".join([str(k), f"{t:.6f}", *body, *take.cells(k)]) for k, t in enumerate(take.t_s)]
    return "\r\n".join([*lines, *rows, ""])


def vicon_text(take: Take) -> str:
    columns = 3 * len(take.names)
    names = [cell for name in take.names for cell in (f"Robot:{name}", "", "")]
    head = [
        "Trajectories",
        "100",
        ",".join(["", "", *names]),
        ",".join(["Frame", "Sub Frame", *["X", "Y", "Z"] * (columns // 3)]),
    ]
    rows = [",".join([str(k + 1), "0", *take.cells(k)]) for k in range(len(take.t_s))]
    return "\n".join([*head, ",".join(["", "", *["mm"] * columns]), *rows, ""])


def qualisys_text(take: Take) -> str:
    """With all that can be exported: types, a header that ends in a tab, and the columns Frame and Time."""
    about = {
        "NO_OF_FRAMES": f"{len(take.t_s)}",
        "NO_OF_CAMERAS": "10",
        "NO_OF_MARKERS": f"{len(take.names)}",
        "FREQUENCY": "100",
        "NO_OF_ANALOG": "0",
        "ANALOG_FREQUENCY": "0",
        "DESCRIPTION": "--",
        "TIME_STAMP": "2026-05-04, 15:25:39.000\t2063631.96175450",
        "DATA_INCLUDED": "3D",
        "MARKER_NAMES": "\t".join(take.names),
        "TRAJECTORY_TYPES": "\t".join(["Measured"] * len(take.names)),
    }
    head = [f"{word}\t{values}" for word, values in about.items()]
    columns = [f"{name} {axis}" for name in take.names for axis in "XYZ"]
    rows = ["\t".join([str(k + 1), f"{t:.5f}", *take.cells(k)]) for k, t in enumerate(take.t_s)]
    return "\n".join([*head, "\t".join(["Frame", "Time", *columns, ""]), *rows, ""])


def trc_text(take: Take) -> str:
    count = len(take.names)
    head = [
        "PathFileType\t4\t(X/Y/Z)\ttake.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"100.00\t100.00\t{len(take.t_s)}\t{count}\tmm\t100.00\t1\t{len(take.t_s)}",
        "\t".join(["Frame#", "Time", *(cell for name in take.names for cell in (name, "", ""))]),
        "\t".join(["", "", *(f"{axis}{k + 1}" for k in range(count) for axis in "XYZ")]),
        "",
    ]
    rows = ["\t".join([str(k + 1), f"{t:.6f}", *take.cells(k), ""]) for k, t in enumerate(take.t_s)]
    return "\n".join([*head, *rows, ""])


def write_c3d(take: Take, path: Path) -> None:
    import ezc3d

    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["UNITS"]["value"], point["RATE"]["value"], point["LABELS"]["value"] = ["mm"], [100.0], take.names
    points = np.ones((4, len(take.names), len(take.t_s)))
    points[:3] = np.transpose(take.position_mm, (2, 1, 0))
    file["data"]["points"] = points
    file.write(str(path))
