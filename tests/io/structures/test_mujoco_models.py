"""MuJoCo models as laboratories write them: old options, hubs, actuated cables, springs in pairs."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from command_line import printed_by
from structures import written
from tensegraph import InputError, read_structure
from tensegraph.models.structure.lengths import member_length_m

OLD = '<option timestep="0.002" collision="predefined"><flag sensornoise="enable"/></option>'
"""Attributes that MuJoCo knew before version 3."""
ANCHORS = '<site name="a" pos="0 0 0"/><site name="b" pos="0.3 0 0"/><site name="c" pos="0 0.3 0"/>'
ROD = (
    '<body name="rod" pos="0.1 0.1 0.1"><freejoint/><geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.01" '
    'mass="0.05"/><site name="n1" pos="0 0 0"/><site name="n2" pos="0 0 0.3"/></body>'
)
STRIPS = (
    '<spatial name="t1" stiffness="100" springlength="0 0.1"><site site="a"/><site site="n1"/></spatial>'
    '<spatial name="t2" stiffness="200" springlength="0.2"><site site="b"/><site site="n1"/></spatial>'
    '<spatial name="t3" stiffness="300" springlength="0.3"><site site="c"/><site site="n2"/></spatial>'
)
CABLES = "".join(
    f'<spatial name="t{k}" {spring}><site site="{one}"/><site site="{other}"/></spatial>'
    for k, spring, one, other in [
        (1, "", "a", "n1"),
        (2, "", "b", "n1"),
        (3, 'stiffness="60" springlength="0.3"', "c", "n2"),
        (4, 'stiffness="50" springlength="0 0.1"', "c", "n1"),
    ]
)
ACTUATORS = (
    '<general tendon="t1" gear="2" gainprm="1" biastype="affine" biasprm="40 -100 0" forcelimited="true" '
    'forcerange="-600 0" ctrlrange="-5 5" ctrllimited="true"/>'
    '<position tendon="t2" kp="400" ctrllimited="true" ctrlrange="0.15 0.3"/>'
    '<position name="servo" tendon="t3" kp="3"/>'
    '<motor tendon="t4" gear="50"/>'
)


def model(tendons: str, *, bodies: str = ROD, before: str = "", after: str = "") -> str:
    world = f"<worldbody>{ANCHORS}{bodies}</worldbody>"
    return f"<mujoco>{before}{world}<tendon>{tendons}</tendon>{after}</mujoco>"


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as refused:
        read_structure(path)
    assert "\n" not in str(refused.value)
    return str(refused.value).removeprefix(f"{path}: ")


def assert_same(one, other) -> None:
    np.testing.assert_array_equal(one.structure.tendons, other.structure.tendons)
    np.testing.assert_array_equal(one.structure.natural_length_m, other.structure.natural_length_m)
    np.testing.assert_array_equal(one.node_position_m, other.node_position_m)
    np.testing.assert_array_equal(one.mechanics.rod_mass_kg, other.mechanics.rod_mass_kg)


class TestOptionsOfOtherVersions:
    def test_are_not_read(self, tmp_path: Path) -> None:
        old = written(tmp_path, model(STRIPS, before=f'{OLD}<visual><old x="1"/></visual>'), "old.xml")
        with pytest.raises(ValueError, match="Schema violation"):
            mujoco.MjModel.from_xml_path(str(old))
        assert_same(read_structure(old), read_structure(written(tmp_path, model(STRIPS))))

    def test_are_not_read_in_included_files_and_meshes_are_found(self, tmp_path: Path) -> None:
        """A file of nothing but an option must not become empty, which MuJoCo refuses."""
        mesh = '<asset><mesh name="m" file="tip.obj"/></asset>'
        rod = ROD.replace('mass="0.05"/>', 'mass="0.05"/><geom type="mesh" mesh="m" mass="0.02"/>')
        compiler = '<compiler meshdir="meshes"/>'
        text = model(STRIPS, bodies='<include file="parts/rod.xml"/>', before=f'{compiler}<include file="option.xml"/>')
        old = written(tmp_path, text.replace("</mujoco>", f"{mesh}</mujoco>"))
        written(tmp_path, f"<mujocoinclude>{OLD}</mujocoinclude>", "option.xml")
        written(tmp_path, f"<mujocoinclude>{rod}</mujocoinclude>", "parts/rod.xml")
        tetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
        written(tmp_path, tetrahedron, "meshes/tip.obj")
        told = read_structure(old)
        assert told.mechanics.rod_mass_kg == pytest.approx([0.07])
        assert told.structure.tendons.tolist() == [[0, 3], [1, 3], [2, 4]]

    def test_mujoco_s_own_line_stays_where_that_does_not_help(self, tmp_path: Path) -> None:
        old = written(tmp_path, model(STRIPS, before='<compiler coordinate="global"/>'))
        assert refusal(old).startswith("MuJoCo cannot read it: XML Error: global coordinates no longer supported")
        twice = '<include file="x/part.xml"/><include file="y/part.xml"/>'
        old = written(tmp_path, model(STRIPS, before=twice))
        written(tmp_path, f"<mujocoinclude>{OLD}</mujocoinclude>", "x/part.xml")
        written(tmp_path, "<mujocoinclude><statistic/></mujocoinclude>", "y/part.xml")
        assert "unrecognized attribute: 'collision'" in refusal(old)  # MuJoCo takes files in memory by their names
        old = written(tmp_path, model(STRIPS, before=f'{OLD}<include file="none.xml"/>'))
        assert refusal(old).startswith("MuJoCo cannot read it")


class TestHubs:
    SITES = "".join(
        f'<site name="{end}{k}" pos="{x} {y} {z}"/>'
        for end, z in (("low", 0.0), ("high", 0.3))
        for k, (x, y) in enumerate([(0.004, 0.003), (-0.004, 0.003), (0.0, -0.006)])
    )
    BODY = ROD[: ROD.index("<site")] + SITES + "</body>"
    TENDONS = "".join(
        f'<spatial stiffness="100" springlength="0.12"><site site="{a}"/><site site="{end}{k}"/></spatial>'
        for end in ("low", "high")
        for k, a in enumerate("abc")
    )

    def test_are_the_ends_of_a_rod_by_hand(self, tmp_path: Path) -> None:
        """Each tendon is stretched between the nodes as much as between its sites."""
        told = read_structure(written(tmp_path, model(self.TENDONS, bodies=self.BODY)))
        assert told.bodies == ()
        assert told.structure.rod_length_m == pytest.approx([0.3])
        assert told.node_position_m[3:] == pytest.approx(np.array([[0.1, 0.1, 0.4], [0.1, 0.1, 0.1]]))
        assert told.geometry.hub_radius_m == pytest.approx(0.006)
        low_m = np.array([[0.104, 0.103, 0.1], [-0.204, 0.103, 0.1], [0.1, -0.206, 0.1]])  # each from its anchor
        stretch_m = np.linalg.norm(low_m, axis=1) - 0.12
        lengths_m = told.structure.tendon_length_m(told.node_position_m)
        assert (lengths_m - told.structure.natural_length_m)[:3] == pytest.approx(stretch_m)
        assert told.mechanics.rod_mass_kg == pytest.approx([0.05])

    def test_are_kept_in_toml_and_said(self, tmp_path: Path) -> None:
        written(tmp_path, model(self.TENDONS, bodies=self.BODY, before=OLD))
        shown = printed_by("structure", "robot.xml", "--out", "robot.toml", cwd=tmp_path)
        assert "tendons end up to 0.006 m beside the ends of rods" in shown
        assert read_structure(tmp_path / "robot.toml").geometry.hub_radius_m == pytest.approx(0.006)

    def test_a_wide_group_is_a_rigid_body(self, tmp_path: Path) -> None:
        wide = self.BODY.replace("0.004", "0.06").replace("0.003", "0.05").replace("-0.006", "-0.08")
        told = read_structure(written(tmp_path, model(self.TENDONS, bodies=wide)))
        assert len(told.bodies[0]) == 6
        assert told.geometry.hub_radius_m == 0.0


class TestActuatedCables:
    def test_by_hand(self, tmp_path: Path) -> None:
        """t1: 40 - 100 (2 l) is zero at 0.2 m, and pulls 2 (200 l - 40). t3: 60 (l - 0.3) + 3 l = 63 (l - 18 / 63)."""
        told = read_structure(written(tmp_path, model(CABLES, after=f"<actuator>{ACTUATORS}</actuator>")))
        assert told.mechanics.stiffness_n_per_m == pytest.approx([400, 400, 63, 50])
        assert told.structure.natural_length_m == pytest.approx([0.2, 0.15, 18 / 63, 0.1])
        assert told.mechanics.push_back == pytest.approx([0, 1, 1, 0])

    def test_pull_as_in_mujoco(self, tmp_path: Path) -> None:
        """In the poses that the model does not start in, too, taut and slack."""
        path = written(tmp_path, model(CABLES, after=f"<actuator>{ACTUATORS}</actuator>"))
        told = read_structure(path)
        made = mujoco.MjModel.from_xml_path(str(path))
        data = mujoco.MjData(made)
        rng = np.random.default_rng(0)
        slack = 0
        for _ in range(20):
            moved_m = rng.normal(0, 0.1, 3)
            data.qpos[:3] = 0.1 + moved_m
            mujoco.mj_forward(made, data)
            x = told.node_position_m + np.outer(np.arange(5) > 2, moved_m)
            pairs = told.structure.tendons
            over_m = member_length_m(x, pairs) - told.structure.natural_length_m
            k = told.mechanics.stiffness_n_per_m * np.where(over_m < 0, told.mechanics.push_back, 1.0)
            along = (x[pairs[:, 0]] - x[pairs[:, 1]]) / member_length_m(x, pairs)[:, None]
            force_n = (k * over_m) @ along  # every second end is on the rod
            np.testing.assert_allclose(force_n, (data.qfrc_passive + data.qfrc_actuator)[:3], atol=1e-9)
            slack += int((over_m < 0).sum())
        assert slack > 5


class TestSpringsBetweenTheSameSites:
    TWO = '<spatial name="t4" stiffness="50" springlength="{}"><site site="n1"/><site site="a"/></spatial>'

    @pytest.mark.parametrize(
        ("springlength", "natural_m", "push_back"),
        [("0 0.1", 0.1, 0.0), ("0 0.16", 0.12, 0.0), ("0.16", 0.12, 1 / 3)],
        ids=["alike", "both taut", "one pushes"],
    )
    def test_are_one_tendon(self, springlength: str, natural_m: float, push_back: float, tmp_path: Path) -> None:
        """100 (l - 0.1) + 50 (l - L) = 150 (l - (10 + 50 L) / 150)."""
        told = read_structure(written(tmp_path, model(STRIPS + self.TWO.format(springlength))))
        assert told.structure.tendons.tolist() == [[0, 3], [1, 3], [2, 4]]
        assert told.mechanics.stiffness_n_per_m == pytest.approx([150, 200, 300])
        assert told.structure.natural_length_m == pytest.approx([natural_m, 0.2, 0.3])
        assert told.mechanics.push_back == pytest.approx([push_back, 1, 1])

    def test_all_that_push_are_one_tendon_at_any_length(self, tmp_path: Path) -> None:
        """200 (l - 0.2) + 50 (l - 0.4) = 250 (l - 0.24), where one is slack at the start too."""
        told = read_structure(written(tmp_path, model(STRIPS + self.TWO.format("0.4").replace('"a"', '"b"'))))
        assert told.mechanics.stiffness_n_per_m[1] == pytest.approx(250)
        assert told.structure.natural_length_m[1] == pytest.approx(0.24)
        assert told.mechanics.push_back == pytest.approx([0, 1, 1])

    @pytest.mark.parametrize("springlength", ["0 0.4", "0.4"])
    def test_one_that_is_slack_is_refused(self, springlength: str, tmp_path: Path) -> None:
        """With one that does not push, the sum is another spring where it is slack."""
        path = written(tmp_path, model(STRIPS + self.TWO.format(springlength)))
        assert refusal(path) == (
            "tendon 't4': another tendon joins the same nodes, and this one is slack: expected one"
        )


WELDED = ROD.replace('"rod"', '"other"').replace("n1", "m1").replace("n2", "m2").replace("0.1 0.1 0.1", "0.2 0.2 0.1")
REFUSED = {
    "tendon 't1': expected a stiffness above 0, or an actuator whose force falls with the length (biasprm), got 0 and "
    "actuator 'pull', which is no spring while nothing controls it": model(
        CABLES, after='<actuator><motor name="pull" tendon="t1"/></actuator>'
    ),
    "tendon 't1': expected a stiffness above 0, or an actuator whose force falls with the length (biasprm), got 0 and "
    "no actuator": model(CABLES),
    "tendon 't1': expected a stiffness above 0, or an actuator whose force falls with the length (biasprm), got 0 and "
    "actuator 'winch', which is no spring while nothing controls it": model(
        CABLES, after='<actuator><intvelocity name="winch" tendon="t1" kp="9" actrange="0.1 0.3"/></actuator>'
    ),
    "tendon 't1': expected a spring that pulls, got one that only pushes": model(
        CABLES,
        after='<actuator><position tendon="t1" kp="9" ctrllimited="true" ctrlrange="0.1 0.3" forcelimited="true" '
        'forcerange="0 50"/><position tendon="t2" kp="9" ctrllimited="true" ctrlrange="0.1 0.3"/></actuator>',
    ),
    "tendon 't1': expected a natural length of 0.003 m or more, a hundredth of the largest body, got 0 m: give its "
    "actuator a ctrlrange, or name a joint by a connect constraint": model(
        CABLES, after='<actuator><position tendon="t1" kp="9"/><position tendon="t2" kp="9"/></actuator>'
    ),
    "tendon 't4': expected to join two bodies, got two sites of one": model(
        STRIPS + '<spatial name="t4" stiffness="1"><site site="n1"/><site site="n2"/></spatial>'
    ),
    "equality 0: expected connect, the only constraint between rods that is read, got weld": model(
        STRIPS, bodies=ROD + WELDED, after='<equality><weld body1="rod" body2="other"/></equality>'
    ),
}


def test_of_several_springs_that_only_push_the_first_is_named(tmp_path: Path) -> None:
    """In the order of the model, not in that of a set."""
    pushing = "".join(
        f'<position tendon="t{k}" kp="9" ctrllimited="true" ctrlrange="0.1 0.3" forcelimited="true" forcerange="0 50"/>'
        for k in (2, 1)
    )
    path = written(tmp_path, model(CABLES, after=f"<actuator>{pushing}</actuator>"))
    assert refusal(path) == "tendon 't1': expected a spring that pulls, got one that only pushes"


@pytest.mark.skipif(not hasattr(mujoco.MjModel, "tendon_stiffnesspoly"), reason="MuJoCo before version 4")
def test_a_stiffness_that_changes_with_the_length_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, model(STRIPS.replace('stiffness="200"', 'stiffness="200 0 30"')))
    line = "tendon 't2': stiffness: expected one number, a spring whose force is linear, got 200 0 30"
    assert refusal(path) == line


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("a", "site 0: expected a name in UTF-8, got b'\\xe9'"),
        ("t1", "MuJoCo cannot read it: expected text in UTF-8, got invalid continuation byte"),
    ],
)
def test_a_name_in_latin_1_is_refused(name: str, line: str, tmp_path: Path) -> None:
    """MuJoCo reads it, or names it in its own refusal; what is in comments does not matter."""
    text = model(STRIPS, before="<!-- \xe9 -->")
    (tmp_path / "robot.xml").write_bytes(text.encode("latin-1"))
    assert len(read_structure(tmp_path / "robot.xml").structure.tendons) == 3
    named = text.replace(f'"{name}"', '"\xe9"').replace('"t2"', '"\xe9"' if name == "t1" else '"t2"')
    (tmp_path / "robot.xml").write_bytes(named.encode("latin-1"))
    assert refusal(tmp_path / "robot.xml") == line


@pytest.mark.parametrize("line", REFUSED)
def test_what_cannot_be_read_is_refused_in_one_line(line: str, tmp_path: Path) -> None:
    assert refusal(written(tmp_path, REFUSED[line])) == line
