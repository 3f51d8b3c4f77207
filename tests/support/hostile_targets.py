"""Commands and the files that they read, as small as they can be: what the hostile tests change and run."""

import shutil
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

import tensegraph as tg
from capture_files import motive_text, qualisys_text, take_of, trc_text, vicon_text, write_c3d
from command_line import printed_by
from plan_edits import PLANS
from roll import ROLL
from structures import YAML
from trial_edits import cut

EXAMPLES = Path(__file__).parents[2] / "examples"
SHIPPED_MODEL = EXAMPLES.parent / "models" / "data" / "stretching.safetensors"
REST_S = 0.2
"""How long the trials stand at rest; the examples' two seconds would make a run five times as long."""

Tables = dict[str, Any]


@dataclass(frozen=True)
class Target:
    """A command, and the files of which one is changed before it runs."""

    make: Callable[[Path], object]
    """Writes the files into a directory that exists and is empty."""
    command: tuple[str, ...]
    """What follows `tensegraph`, with paths from that directory."""
    files: tuple[str, ...]
    """Those to change, one of them; a name that stands twice is changed twice as often."""
    other: str | None = None
    """A file of another kind, whose rows are mixed into the one that is changed."""
    slow: bool = False
    """Whether a run takes long, or differs little from that of another; then `-m long` alone attacks it, and a tenth as
    often."""
    refused: bool = False
    """Whether the command is refused even with the files as they are: no board is there."""


def edited(path: Path, edit: Callable[[Tables], object]) -> None:
    """Rewrite a TOML file with its tables edited in place."""
    tables = tomllib.loads(path.read_text())
    edit(tables)
    path.write_text(tomli_w.dumps(tables))


def beginning_of(source: Path, target: Path) -> None:
    """Copy the first readings of a trial, with a shorter rest."""
    shutil.copytree(source, target, dirs_exist_ok=True)
    cut(target, 0.4)
    edited(target / "trial.toml", lambda trial: trial["rest"].update(seconds=REST_S))


def with_config(trial: Path) -> None:
    shutil.copy(SHIPPED_MODEL, trial / "model.safetensors")
    (trial / "config.toml").write_text("[frames]\nrate_hz = 20.0\n[noise]\nforce_n = 0.1\n[smoother]\nlag = 5\n")


def press(folder: Path) -> None:
    beginning_of(EXAMPLES / "press_01", folder)
    with_config(folder)


def roll(folder: Path) -> None:
    """With ranges to two beacons and positions of two nodes beside the inertial sensor."""
    beginning_of(ROLL, folder)
    with_config(folder)
    truth = tg.open_trial(folder).truth()
    assert truth is not None
    beacon_m = [[1.0, 0.0, 0.5], [0.0, 1.0, 0.5]]
    ranges, positions = ["t_s,beacon,node,range_m"], ["t_s,node,x_m,y_m,z_m"]
    for t_s, node_m in zip(truth.t_s[::2], truth.node_position_m[::2], strict=True):
        ranges += [f"{t_s:.3f},{b},3,{np.linalg.norm(node_m[3] - at_m):.4f}" for b, at_m in enumerate(beacon_m)]
        positions += [f"{t_s:.3f},{node}," + ",".join(f"{x:.4f}" for x in node_m[node]) for node in (3, 7)]
    (folder / "ranges.csv").write_text("\n".join([*ranges, ""]))
    (folder / "positions.csv").write_text("\n".join([*positions, ""]))
    aids = {"range": [{"file": "ranges.csv", "beacon_position_m": beacon_m}], "position": [{"file": "positions.csv"}]}
    edited(folder / "trial.toml", lambda trial: trial.update(aids))


def plan_of(name: str, edits: Tables) -> Tables:
    """Return a plan of the examples, complete in itself and shortened."""
    plan = tomllib.loads(PLANS[name].read_text())
    if "extends" in plan:
        below = tomllib.loads((PLANS[name].parent / plan.pop("extends")).read_text())
        below = below | {"load": {}}
        plan = below | {k: below.get(k, {}) | v if isinstance(v, dict) else v for k, v in plan.items()}
    push = {"at_s": 0.2, "ramp_s": 0.1, "hold_s": 0.1, "nodes": [3], "force_n": 1.0, "direction": [0.0, 0.0, -1.0]}
    plan = plan | {"duration_s": 0.4, "load": {"press": [push]}} | edits
    plan.pop("fault", None)
    plan["rest"]["seconds"] = REST_S
    return plan


def plan(folder: Path) -> None:
    (folder / "plan.toml").write_text(tomli_w.dumps(plan_of("prism", {})))


MOTOR = {
    "tendons": [3, 4, 5],
    "strip_length_m": 0.1,
    "at_s": [0.25],
    "change_m": [-0.001],
    "speed_m_per_s": 0.01,
    "rate_hz": 50.0,
    "noise_m": 0.00005,
    "drum_sigma": 0.02,
}


def simulated(folder: Path, name: str, edits: Tables) -> None:
    """Write the trial of a shortened plan into a directory."""
    (folder / "plan.toml").write_text(tomli_w.dumps(plan_of(name, edits)))
    printed_by("simulate", "plan.toml", "--out", "made", cwd=folder)
    for file in (folder / "made").iterdir():
        shutil.move(file, folder / file.name)
    (folder / "made").rmdir()
    (folder / "plan.toml").unlink()
    with_config(folder)


def prism(folder: Path) -> None:
    simulated(folder, "prism", {"motor": [MOTOR]})


def hang(folder: Path) -> None:
    simulated(folder, "hang", {})


def without_boards(folder: Path, kind: str, name: str, scale: Callable[[tg.Trial], Any]) -> None:
    """Replace the boards of the prism by one table whose rows follow from the true lengths."""
    simulated(folder, "prism", {})
    trial = tg.open_trial(folder)
    truth = trial.truth()
    assert truth is not None
    rows = ["t_s," + ",".join(name.format(e) for e in range(9))]
    of_m = scale(trial)
    for t_s, node_m in zip(truth.t_s, truth.node_position_m, strict=True):
        values = of_m(trial.description.structure.tendon_length_m(node_m))
        rows.append(f"{t_s:.3f}," + ",".join(f"{value:.6g}" for value in values))
    (folder / f"{kind}.csv").write_text("\n".join([*rows, ""]))

    def edit(table: Tables) -> None:
        del table["board"], table["adc"]
        table[kind] = {"file": f"{kind}.csv"}

    edited(folder / "trial.toml", edit)


def lengths(folder: Path) -> None:
    without_boards(folder, "lengths", "l{}_m", lambda _: lambda length_m: length_m)


def resistance(folder: Path) -> None:
    def ohm(trial: tg.Trial) -> Any:
        natural_m, natural_ohm = trial.description.structure.natural_length_m, trial.description.natural_resistance_ohm
        return lambda length_m: natural_ohm * (1 + 0.8 * (length_m / natural_m - 1))

    without_boards(folder, "resistance", "r{}_ohm", ohm)


def bag(folder: Path) -> None:
    """Lengths of the prism as an MCAP file of ROS 2."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    lengths(folder)
    ros = get_typestore(Stores.ROS2_HUMBLE)
    layout = ros.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    rows = np.loadtxt(folder / "lengths.csv", delimiter=",", skiprows=1)
    with Writer(folder / "made", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/lengths", "std_msgs/msg/Float64MultiArray", typestore=ros)
        for t_s, *length_m in rows:
            message = ros.types["std_msgs/msg/Float64MultiArray"](layout=layout, data=np.array(length_m))
            stamp_ns = 1_700_000_000_000_000_000 + int(1e9 * t_s)
            writer.write(connection, stamp_ns, ros.serialize_cdr(message, connection.msgtype))
    shutil.move(next((folder / "made").glob("*.mcap")), folder / "lengths.mcap")
    shutil.rmtree(folder / "made")
    edited(folder / "trial.toml", lambda trial: trial.update(lengths={"file": "lengths.mcap"}))


def result(folder: Path) -> None:
    """A trial in a directory of its own, and the result made from it, of a robot with loads and contacts."""
    (folder / "trial").mkdir()
    roll(folder / "trial")
    printed_by("reconstruct", "trial", "--live", "--figures", "none", "--out", "result", cwd=folder)


def captured(folder: Path) -> None:
    """Eight seconds of the prism pressed in turn, its result, and what four programs write of its motion."""
    pushes = [
        {"at_s": at_s, "ramp_s": 0.2, "hold_s": 0.4, "nodes": [node], "force_n": 2.0, "direction": [0.3, 0.1, -1.0]}
        for at_s, node in ((1.0, 3), (2.2, 4), (3.4, 5), (4.6, 3))
    ]
    (folder / "trial").mkdir()
    simulated(folder / "trial", "prism", {"duration_s": 6.0, "load": {"press": pushes}})
    truth = tg.open_trial(folder / "trial").truth()
    assert truth is not None
    take = take_of(truth.t_s, truth.node_position_m, [4, 0, 2, 5, 3, 1], rate_hz=50.0)
    markers = {name: {"node": int(node)} for name, node in zip(take.names, take.node, strict=False)}
    edited(folder / "trial" / "trial.toml", lambda trial: trial["truth"].update(markers=markers))
    printed_by("reconstruct", "trial", "--live", "--figures", "none", "--out", "result", cwd=folder)
    (folder / "motive.csv").write_text(motive_text(take), newline="")
    (folder / "vicon.csv").write_text(vicon_text(take).replace("Robot:", ""))
    (folder / "take.tsv").write_text(qualisys_text(take))
    (folder / "take.trc").write_text(trc_text(take))
    write_c3d(take, folder / "take.c3d")


def structures(folder: Path) -> None:
    """The prism in each format of structure files."""
    (folder / "robot.yaml").write_text(YAML)
    (folder / "prism.toml").write_text(tomli_w.dumps(plan_of("prism", {})))
    tables = tomllib.loads((folder / "prism.toml").read_text())
    kept = ("tendon_stiffness_n_per_m", "rod_mass_kg", "push_back")
    mechanics = {name: tables["mechanics"][name] for name in kept}
    (folder / "prism.toml").write_text(tomli_w.dumps({"structure": tables["structure"], "mechanics": mechanics}))
    printed_by("structure", "prism.toml", "--out", "robot.xml", cwd=folder)


def strips(folder: Path) -> None:
    """Recordings of two strips, and a description of the rig."""
    (folder / "strips").mkdir()
    rng = np.random.default_rng(5)
    for k in range(3):
        t_s = np.arange(0, 40, 0.25)
        strain = np.abs(((0.02 + 0.02 * k) * t_s + 0.2) % 0.4 - 0.2)
        ohm = 1e6 * (1 + (1 + 0.02 * k) * 1.3 * strain + 1e-3 * rng.standard_normal(len(t_s)))
        rows = [f"{t:.2f},{e:.6f},{r:.0f}" for t, e, r in zip(t_s, strain, ohm, strict=True)]
        text = "\n".join(["# natural_resistance_ohm = 1000000", "t_s,strain,resistance_ohm", *rows, ""])
        (folder / "strips" / f"s{k}.csv").write_text(text)
    (folder / "rig.toml").write_text(
        '[columns]\ntime = "t_s"\nresistance = "resistance_ohm"\nstrain = "strain"\n[units]\ntime = "s"\n'
    )


def rig(folder: Path) -> None:
    shutil.copy(EXAMPLES / "rig.toml", folder)


RECONSTRUCT = ("reconstruct", ".", "--out", "out", "--figures", "none")
WITH_CONFIG = (*RECONSTRUCT, "--config", "config.toml", "--model", "model.safetensors")
MOTOR_FILE = "natural_length0.csv"
TRIAL_FILES = ("trial.toml", "trial.toml", "board0.csv", "config.toml")
TABLES = ("shape", "ellipsoids", "lengths", "status", "contacts", "track", "slips", "estimated_loads")
RESULT_FILES = ("result/run.toml", *(f"result/{name}.csv" for name in TABLES))
LIVE = ("--seconds", "0.4", "--out", "out", "--quiet")
LIVE_REPLAY = (
    *("live", "--replay", ".", "--speed", "4", "--config", "config.toml", "--model", "model.safetensors"),
    *LIVE,
)
EVALUATE = ("evaluate", "result", "--json", "--out", "out")

TARGETS = {
    "press": Target(press, (*WITH_CONFIG, "--live"), (*TRIAL_FILES, "truth.csv", "model.safetensors"), "truth.csv"),
    "press_batch": Target(press, WITH_CONFIG, (*TRIAL_FILES, "board1.csv", "model.safetensors"), "loads.csv"),
    "press_frame": Target(press, (*WITH_CONFIG, "--method", "frame"), TRIAL_FILES, "board1.csv", slow=True),
    "press_paper": Target(press, (*WITH_CONFIG, "--method", "least-squares"), TRIAL_FILES, "board1.csv", slow=True),
    "press_ukf": Target(press, (*WITH_CONFIG, "--method", "ukf"), TRIAL_FILES, "board1.csv"),
    "press_network": Target(press, (*WITH_CONFIG, "--method", "network"), TRIAL_FILES, "board1.csv", slow=True),
    "roll": Target(
        roll, (*WITH_CONFIG, "--live"), (*TRIAL_FILES, "imu0.csv", "ranges.csv", "positions.csv"), "truth.csv"
    ),
    "roll_batch": Target(
        roll,
        WITH_CONFIG,
        ("trial.toml", "imu0.csv", "ranges.csv", "positions.csv", "config.toml"),
        "board0.csv",
        slow=True,
    ),
    "prism": Target(prism, (*WITH_CONFIG, "--live"), (*TRIAL_FILES, MOTOR_FILE, "model.safetensors"), "loads.csv"),
    "prism_batch": Target(prism, WITH_CONFIG, (*TRIAL_FILES, MOTOR_FILE), "truth.csv"),
    "hang": Target(hang, (*WITH_CONFIG, "--live"), (*TRIAL_FILES, "imu0.csv"), "truth.csv", slow=True),
    "lengths": Target(lengths, (*WITH_CONFIG, "--live"), ("trial.toml", "lengths.csv", "config.toml"), "truth.csv"),
    "resistance": Target(
        resistance, (*WITH_CONFIG, "--live"), ("trial.toml", "resistance.csv", "model.safetensors"), "truth.csv"
    ),
    "bag": Target(bag, (*WITH_CONFIG, "--live"), ("trial.toml", "lengths.mcap", "lengths.mcap"), "lengths.csv"),
    "simulate": Target(plan, ("simulate", "plan.toml", "--out", "out"), ("plan.toml",)),
    "structure_toml": Target(structures, ("structure", "prism.toml", "--out", "out.toml"), ("prism.toml",)),
    "structure_mjcf": Target(structures, ("structure", "prism.toml", "--out", "out.xml"), ("prism.toml",)),
    "structure_yaml": Target(structures, ("structure", "robot.yaml", "--out", "out.toml"), ("robot.yaml",)),
    "structure_xml": Target(structures, ("structure", "robot.xml", "--out", "out.toml"), ("robot.xml",)),
    "export_npz": Target(result, ("export", "result", "--out", "out.npz"), RESULT_FILES, "trial/imu0.csv"),
    "export_mat": Target(result, ("export", "result", "--out", "out.mat"), RESULT_FILES, "trial/truth.csv"),
    "export_glb": Target(result, ("export", "result", "--out", "out.glb", "--at", "0.3"), RESULT_FILES),
    "evaluate": Target(
        result,
        EVALUATE,
        (*RESULT_FILES, "trial/truth.csv", "trial/loads.csv", "trial/contacts.csv"),
        "trial/imu0.csv",
        slow=True,
    ),
    "motive": Target(captured, (*EVALUATE, "--truth", "motive.csv"), ("motive.csv",), "vicon.csv", slow=True),
    "vicon": Target(captured, (*EVALUATE, "--truth", "vicon.csv"), ("vicon.csv",), "motive.csv", slow=True),
    "qualisys": Target(captured, (*EVALUATE, "--truth", "take.tsv"), ("take.tsv",), "vicon.csv", slow=True),
    "trc": Target(captured, (*EVALUATE, "--truth", "take.trc"), ("take.trc",), "vicon.csv", slow=True),
    "c3d": Target(captured, (*EVALUATE, "--truth", "take.c3d"), ("take.c3d",), slow=True),
    "calibrate": Target(
        strips,
        ("calibrate", "strips", "--rig", "rig.toml", "--epochs", "1", "--out", "out.safetensors"),
        ("rig.toml", "strips/s0.csv", "strips/s1.csv"),
        "rig.toml",
        slow=True,
    ),
    "live_replay": Target(press, LIVE_REPLAY, (*TRIAL_FILES, "board1.csv"), "board1.csv", slow=True),
    "live_replay_roll": Target(roll, LIVE_REPLAY, (*TRIAL_FILES, "imu0.csv", "positions.csv"), "truth.csv", slow=True),
    "live_twin": Target(plan, ("live", "--twin", "plan.toml", *LIVE), ("plan.toml",), slow=True),
    "live_rig": Target(
        rig, ("live", "--rig", "rig.toml", "--port", "./none", *LIVE), ("rig.toml",), refused=True, slow=True
    ),
    "view": Target(result, ("view", "result"), (*RESULT_FILES, "trial/trial.toml", "trial/truth.csv"), slow=True),
    "compare": Target(
        result,
        ("compare", "trial", "--method", "live", "--out", "out"),
        ("trial/trial.toml", "trial/board0.csv", "trial/truth.csv"),
        slow=True,
    ),
    "export_parquet": Target(result, ("export", "result", "--out", "out.parquet"), RESULT_FILES, slow=True),
    "export_netcdf": Target(result, ("export", "result", "--out", "out.nc"), RESULT_FILES, slow=True),
    "export_ros2": Target(result, ("export", "result", "--out", "out.mcap"), RESULT_FILES, slow=True),
    "export_rerun": Target(result, ("export", "result", "--out", "out.rrd"), RESULT_FILES, slow=True),
    "export_ply": Target(result, ("export", "result", "--out", "out.ply", "--at", "0.3"), RESULT_FILES, slow=True),
    "record": Target(
        rig, ("record", "--rig", "rig.toml", "--out", "out", "--port", "./none"), ("rig.toml",), refused=True, slow=True
    ),
}
