"""Structure files: each format read back, by hand, and what is refused of each."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from structures import PLATE_M, TOWER, TOWER_M, YAML, plate, written
from tensegraph import InputError, read_structure
from tensegraph.io.structures.new_trial import BuiltIn, write_new_trial
from tensegraph.io.structures.structure_output import write_structure
from tensegraph.models.twin.mjcf import mjcf
from twin_bodies import body, resting

XML = """<mujoco>
<worldbody>
<site name="a" pos="0 0 0"/><site name="b" pos="0.3 0 0"/><site name="c" pos="0 0.3 0"/>
<body name="rod" pos="0.1 0.1 0.1"><freejoint/><geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.01" mass="0.05"/>
<site name="n1" pos="0 0 0"/><site name="n2" pos="0 0 0.3"/></body>
</worldbody>
<tendon>
<spatial name="t1" stiffness="100" springlength="0 0.1"><site site="a"/><site site="n1"/></spatial>
<spatial name="t2" stiffness="200" springlength="0.2"><site site="b"/><site site="n1"/></spatial>
<spatial name="t3" stiffness="300"><site site="c"/><site site="n2"/></spatial>
</tendon>
</mujoco>"""


def test_a_yaml_file_in_decimetres_by_hand(tmp_path: Path) -> None:
    """y is up; a rod weighs density pi r^2 l; 50 kg dm/s^2 at 100 N/m shorten a tendon by half a decimetre."""
    told = read_structure(written(tmp_path, YAML, "robot.yaml"), unit_m=0.1)
    assert told.node_position_m == pytest.approx(np.array([[0, 0, 0], [0, 0, 1], [0.6, 0, 0.2], [0.6, -0.8, 0.2]]))
    assert told.structure.rod_length_m == pytest.approx([1.0, 0.8])
    assert told.structure.tendons.tolist() == [[0, 2], [1, 2], [0, 3], [1, 3]]
    assert told.structure.natural_length_m[1] == pytest.approx(1.0 - 0.05)
    assert told.mechanics.rod_mass_kg == pytest.approx(0.5 * np.pi * 0.04 * np.array([10, 8]))
    assert told.structure.is_free_standing


@pytest.mark.parametrize("number", ["1e1", "1E+01", "+1.0e1", "10", "10."])
def test_numbers_of_yaml_1_2_are_read(number: str, tmp_path: Path) -> None:
    told = read_structure(written(tmp_path, YAML.replace("[0, 10, 0]", f"[-1e-05, {number}, 0]"), "robot.yaml"))
    assert told.node_position_m[1] == pytest.approx([-1e-5, 0, 10])


def test_keys_that_a_merge_brings_may_be_told_anew(tmp_path: Path) -> None:
    merged = YAML.replace("{stiffness: 100", "{<<: {stiffness: 7}, stiffness: 100")
    assert read_structure(written(tmp_path, merged, "robot.yaml")).mechanics.stiffness_n_per_m[0] == 100


def test_other_simulators_name_connections_and_types(tmp_path: Path) -> None:
    text = YAML.replace("pair_groups", "connections").replace("class: tgRodInfo, ", "type: bar, ")
    text = text.replace("class: tgBasicActuatorInfo, parameters: {stiffness: 100, pretension: 50}",
                        "type: string, stiffness: 100, initial_length_ratio: 0.9")  # fmt: skip
    told = read_structure(written(tmp_path, text, "robot.yml"))
    assert told.node_position_m[1] == pytest.approx([0, 10, 0])  # no axis is told to be up
    assert told.structure.natural_length_m[1] == pytest.approx(9.0)


def test_a_mujoco_model_by_hand(tmp_path: Path) -> None:
    """A spring with one length pushes as it pulls; one without is slack where the model starts."""
    told = read_structure(written(tmp_path, XML, "robot.xml"))
    assert told.structure.rods.tolist() == [[3, 4]]
    assert told.structure.rod_length_m == pytest.approx([0.3])
    assert told.structure.anchors.tolist() == [0, 1, 2]
    assert told.structure.tendons.tolist() == [[0, 3], [1, 3], [2, 4]]
    assert told.structure.natural_length_m == pytest.approx([0.1, 0.2, np.sqrt(0.01 + 0.04 + 0.16)])
    assert told.mechanics.push_back == pytest.approx([0, 1, 1])
    assert told.mechanics.stiffness_n_per_m == pytest.approx([100, 200, 300])
    assert told.mechanics.rod_mass_kg == pytest.approx([0.05])


@pytest.mark.parametrize("count", [12, 6])
def test_the_twin_s_own_model_is_read_back(count: int, tmp_path: Path) -> None:
    structure, shape_m = resting(count)
    told = read_structure(written(tmp_path, mjcf(body(structure), shape_m, 0.001), "twin.xml"))
    for name in ("rods", "tendons", "natural_length_m", "anchors"):
        np.testing.assert_array_equal(getattr(told.structure, name), getattr(structure, name))
    np.testing.assert_allclose(told.structure.rod_length_m, structure.rod_length_m, rtol=1e-9)
    np.testing.assert_allclose(told.structure.anchor_position_m, structure.anchor_position_m, atol=1e-5)
    assert told.mechanics.push_back == pytest.approx(np.full(len(structure.tendons), 0.1))


def test_rods_that_share_nodes_are_tied_and_read_back(tmp_path: Path) -> None:
    told = read_structure(written(tmp_path, mjcf(body(TOWER), TOWER_M, 0.001), "tower.xml"))
    np.testing.assert_array_equal(told.structure.rods, TOWER.rods)
    np.testing.assert_array_equal(told.structure.tendons, TOWER.tendons)


@pytest.mark.parametrize("noise_m", [0.0, 0.0003])
def test_a_model_of_joined_rods_is_read_back_from_any_shape(noise_m: float, tmp_path: Path) -> None:
    """Of metre-long rods at the shape of least energy, a few hundredths of a millimetre off, or at a measured one."""
    start, _ = write_new_trial(BuiltIn("tower", 1.0), tmp_path / "tower")
    told = read_structure(start)
    measured_m = told.node_position_m + np.random.default_rng(1).normal(0.0, noise_m, told.node_position_m.shape)
    write_structure(replace(told, rest_position_m=measured_m if noise_m else None), [tmp_path / "t.xml"], title="t")
    back = read_structure(tmp_path / "t.xml").structure
    np.testing.assert_array_equal(back.rods, told.structure.rods)
    np.testing.assert_allclose(back.rod_length_m, 1.0, atol=1e-8)


@pytest.mark.parametrize("suffix", [".toml", ".xml"])
def test_what_is_written_is_read_back(suffix: str, tmp_path: Path) -> None:
    told = plate(push_back=[0.0, *[0.1] * 7])
    write_structure(told, [tmp_path / f"plate{suffix}"], title="plate")
    back = read_structure(tmp_path / f"plate{suffix}")
    renumber = np.arange(13) if suffix == ".toml" else np.array([0, 1, 2, 3, 12, *range(4, 12)])  # the stem is last
    np.testing.assert_array_equal(back.structure.tendons, renumber[told.structure.tendons])
    np.testing.assert_array_equal(back.structure.anchors, renumber[told.structure.anchors])
    np.testing.assert_allclose(back.structure.natural_length_m, told.structure.natural_length_m)
    np.testing.assert_allclose(
        np.sort(back.structure.rod_length_m)[-2:], 0.2 * np.sqrt(2), rtol=1e-5
    )  # the plate's diagonals
    assert back.bodies == (tuple(sorted(renumber[list(told.bodies[0])].tolist())),)
    assert back.mechanics.push_back == pytest.approx(told.mechanics.push_back)
    masses = [one.mechanics.node_mass_kg(one.structure).sum() for one in (told, back)]
    assert masses == pytest.approx([0.2, 0.2])


def test_a_flat_body_of_a_model_gets_a_node_off_its_plane(tmp_path: Path) -> None:
    sites = "".join(f'<site name="p{k}" pos="{x} {y} 0"/>' for k, (x, y, _) in enumerate(PLATE_M[:4]))
    up = "".join(f'<site name="u{k}" pos="{x} {y} 0.5"/>' for k, (x, y, _) in enumerate(PLATE_M[5:9]))
    tendons = "".join(
        f'<spatial stiffness="100" springlength="0 0.3"><site site="u{k}"/><site site="p{k}"/></spatial>'
        for k in range(4)
    )
    text = (
        f'<mujoco><worldbody>{up}<body><freejoint/><geom type="box" size="0.1 0.1 0.005" mass="0.2"/>{sites}</body>'
        f"</worldbody><tendon>{tendons}</tendon></mujoco>"
    )
    told = read_structure(written(tmp_path, text, "plate.xml"))
    assert told.bodies == ((0, 1, 2, 3, 8),)
    assert told.structure.node_count == 9
    assert abs(told.node_position_m[8, 2]) > 0.05


def test_a_model_with_a_node_that_has_no_mass_is_not_written(tmp_path: Path) -> None:
    text = YAML.replace("foot: [0, 0, 0]", "foot: [0, 0, 0]\n  knot: [2, 2, 2]")
    text = text.replace("- [foot, left]", "- [foot, left]\n    - [knot, left]\n    - [knot, top]")
    told = read_structure(written(tmp_path, text, "robot.yaml"))
    with pytest.raises(InputError, match=r"mechanics\.knot_mass_kg\[1\] above 0, of a node on no rod"):
        write_structure(told, [tmp_path / "robot.xml"], title="robot")
    assert not (tmp_path / "robot.xml").exists()


MALFORMED = {
    "robot.yaml: line 4: is no YAML": YAML.replace("foot: [0, 0, 0]", "foot: [0, 0, 0"),
    "robot.yaml: nodes.top: expected three numbers of a magnitude of at most 1e+15, got [0, 10]": YAML.replace(
        "[0, 10, 0]", "[0, 10]"
    ),
    "robot.yaml: nodes.top: expected three numbers of a magnitude of at most 1e+15, got [0, 1e+200, 0]": YAML.replace(
        "[0, 10, 0]", "[0, 1.0e+200, 0]"
    ),
    "robot.yaml: builders.my_string.stiffness: expected a number from 0 to 1e+15, got 1e+200": YAML.replace(
        "stiffness: 100", "stiffness: 1.0e+200"
    ),
    "robot.yaml: is no YAML: expected whole numbers of 64 bits, got one of 67 bits": YAML.replace(
        "stiffness: 100", "stiffness: 99999999999999999999"
    ),
    "robot.yaml: is no YAML: expected whole numbers of 64 bits, got one of 24000 bits": YAML.replace(
        "nodes:", f"? 0x{'F' * 6000}\n: 1\nnodes:", 1
    ),
    "robot.yaml: is no YAML: a value is not what its tag says": YAML.replace(
        "stiffness: 100", "stiffness: !!timestamp 1"
    ),
    "robot.yaml: pair_groups.my_string[1]: there is no node tip": YAML.replace("[top, left]", "[tip, left]"),
    "robot.yaml: pair_groups.my_rod[0]: expected two nodes": YAML.replace("[foot, top]", "[foot, top, left]"),
    "robot.yaml: pair_groups.my_rod: expected a builder of this name": YAML.replace("  my_rod: {", "  rod: {"),
    "robot.yaml: builders.my_string.stiffness: is missing": YAML.replace("stiffness: 100, ", ""),
    "robot.yaml: builders.my_string.pretension: expected less than": YAML.replace("pretension: 50", "pretension: 9000"),
    "robot.yaml: nodes or": "",
    "robot.yaml: expected nodes": "- 1",
    "robot.yaml: expected at most 1 MiB, got 2 MiB": YAML + "#\n" * (2 << 19),
    "robot.yaml: line 4: is no YAML: the key 'foot' comes twice": YAML.replace("  top:", "  foot:", 1),
    "robot.yaml: substructures: is not read": YAML + "substructures: {}\n",
    "robot.yaml: is no YAML: unacceptable character #x000b": YAML + "# \x0b\n",
    "robot.yaml: line 2: is no YAML": "nodes:\n  a: !!python/object/apply:os.system [ls]\n",
    "robot.xml: MuJoCo cannot read it": XML.replace("</tendon>", ""),
    "robot.xml: MuJoCo warns of it: XML contains a 'NaN'": XML.replace('pos="0.3 0 0"', 'pos="0.3 NaN 0"'),
    "robot.xml: site 'n2': expected to be within 10000 m": XML.replace('pos="0 0 0.3"', 'pos="0 1.7e308 0"'),
    "robot.xml: body 'rod': expected to be within 10000 m of the origin, got nan": XML.replace(
        "<freejoint/>",
        '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 -inf"/><joint type="slide" axis="0 0 1"/>'
        '<joint type="ball"/>',
    ),
    "robot.xml: expected at most 500 copies of a part, got 1e+06": XML.replace(
        "<worldbody>",
        '<worldbody><replicate count="1000" offset="0 0 1"><replicate count="1000" offset="1 0 0">'
        '<body><freejoint/><geom size="1"/></body></replicate></replicate>',
    ),
    "robot.xml: expected textures and height fields of 3e+07 points, got 9e+08": XML.replace(
        "<worldbody>",
        '<asset><texture name="m" type="2d" builtin="flat" width="30000" height="30000"/></asset><worldbody>',
    ),
    "robot.xml: expected textures and height fields of 3e+07 points, got 4e+08": XML.replace(
        "<worldbody>", '<asset><hfield name="m" nrow="20000" ncol="20000" size="1 1 1 1"/></asset><worldbody>'
    ),
    "robot.xml: tendon 't1': expected a spatial tendon from one site to another": XML.replace(
        '<site site="a"/><site site="n1"/>', '<site site="a"/><site site="n1"/><site site="n2"/>'
    ),
    "robot.xml: tendon 't2': expected a stiffness above 0": XML.replace('stiffness="200"', 'stiffness="0"'),
    "robot.xml: tendon 't2': another tendon joins the same nodes": XML.replace('site="b"', 'site="a"').replace(
        'springlength="0.2"', 'springlength="0 0.2"'
    ),
    "robot.xml: body 'rod': expected to be free, or on a ball joint": XML.replace(
        "<freejoint/>", '<joint type="hinge" axis="0 0 1"/>'
    ),
    "robot.xml: expected spatial tendons between sites, got none": XML.split("<tendon>")[0] + "</mujoco>",
    "robot.toml: cannot be read as TOML": "[structure",
    "robot.toml: structure: is missing": "",
    "robot.dae: expected a structure file": "",
}


@pytest.mark.parametrize("message", MALFORMED)
def test_a_malformed_file_is_refused_in_one_line(message: str, tmp_path: Path) -> None:
    path = written(tmp_path, MALFORMED[message], message.split(":")[0])
    with pytest.raises(InputError) as refused:
        read_structure(path)
    text = str(refused.value)
    assert text.startswith(f"{tmp_path}/")
    assert message.removesuffix("nodes or") in text.removeprefix(f"{tmp_path}/")
    assert "\n" not in text


def test_a_model_that_includes_a_pipe_is_refused(tmp_path: Path) -> None:
    """Reading it would wait for ever."""
    os.mkfifo(tmp_path / "part.xml")
    path = written(tmp_path, XML.replace("<worldbody>", '<include file="part.xml"/><worldbody>'), "robot.xml")
    with pytest.raises(InputError, match=r"part\.xml: expected a file, got a pipe"):
        read_structure(path)


def test_keys_beside_the_name_of_a_file_replace_its_own(tmp_path: Path) -> None:
    written(tmp_path, XML, "robot.xml")
    beside = '[structure]\nfile = "robot.xml"\n[mechanics]\ntendon_stiffness_n_per_m = 7.0\n'
    told = read_structure(written(tmp_path, beside, "robot.toml"))
    assert told.mechanics.stiffness_n_per_m == pytest.approx([7.0] * 3)
    assert told.mechanics.rod_mass_kg == pytest.approx([0.05])


@pytest.mark.parametrize("value", ["[1.0]", "0"])
def test_what_is_no_table_beside_the_name_of_a_file_is_refused(value: str, tmp_path: Path) -> None:
    written(tmp_path, XML, "robot.xml")
    path = written(tmp_path, f'mechanics = {value}\n[structure]\nfile = "robot.xml"\n', "robot.toml")
    with pytest.raises(InputError, match=r"robot\.toml: mechanics: "):
        read_structure(path)


@pytest.mark.parametrize("value", ["[1.0]", "0", "'file'"])
def test_a_file_whose_structure_is_no_table_is_refused(value: str, tmp_path: Path) -> None:
    written(tmp_path, f"structure = {value}\n", "robot.toml")
    path = written(tmp_path, '[structure]\nfile = "robot.toml"\n', "trial.toml")
    with pytest.raises(InputError, match=r"robot\.toml: structure: expected a table, got "):
        read_structure(path)
