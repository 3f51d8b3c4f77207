"""What a run consists of, quantity by quantity: name, dimensions, unit and meaning, once for all formats of files."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag

from ..values.readings import Flag, Mode

LABELS: dict[str, tuple[str, ...]] = {
    "axis": ("x", "y", "z"),
    "other_axis": ("x", "y", "z"),
    "semi_axis": ("a", "b", "c"),
    "component": ("x", "y", "z", "w"),
    "end": ("first", "second"),
}
"""Labels of the dimensions that have any; frames are labelled by their time, nodes, tendons and rods are numbered."""
UPPER_TRIANGLE = ("cxx_m2", "cxy_m2", "cxz_m2", "", "cyy_m2", "cyz_m2", "", "", "czz_m2")


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity of a run."""

    dimensions: tuple[str, ...]
    unit: str
    """As UDUNITS writes it; 1 for a number without unit, empty for words."""
    meaning: str
    columns: tuple[str, ...] = ()
    """In a table, the names of the components over the last dimensions, in order; those without a name are left out.
    Without any, the quantity is one column of its own name."""
    codes: Mapping[int, str] = field(default_factory=dict)
    """What its whole numbers mean."""
    bits: bool = False
    """Whether the codes are bits, of which several may be set."""


def codes_of(kind: type[IntEnum] | type[IntFlag]) -> dict[int, str]:
    """Return the names of an enumeration's members in lower case, by their number."""
    return {int(member): str(member.name).lower() for member in kind}


def in_words(quantity: Quantity, code: int) -> str:
    """Return the meaning of a whole number; bits are joined by a vertical bar, as in lengths.csv."""
    if not quantity.bits:
        return quantity.codes[code]
    return "|".join(name for bit, name in quantity.codes.items() if code & bit)


NODES = ("t_s", "node")
TENDONS = ("t_s", "tendon")

QUANTITIES = {
    "t_s": Quantity(("t_s",), "s", "time of the frame on the host's clock"),
    "status": Quantity(("t_s",), "", "from which measurements the frame was estimated, and whether that succeeded"),
    "doubt": Quantity(("t_s",), "", "what explains the readings better than the model; none where nothing does"),
    "smallest_singular_value": Quantity(("t_s",), "1", "of the length Jacobian of the free nodes"),
    "mechanism_sigma_m": Quantity(("t_s",), "m", "standard deviation along the motion that lengths see least"),
    "branch": Quantity(("t_s",), "1", "side of det J = 0: 1 or -1; 0 where J is not square"),
    "other_log_ratio": Quantity(("t_s",), "1", "log likelihood ratio of the shape to the other one; nan without one"),
    "centroid_m": Quantity(("t_s", "axis"), "m", "mean of all nodes", ("centroid_x_m", "centroid_y_m", "centroid_z_m")),
    "centroid_covariance_m2": Quantity(
        ("t_s", "axis", "other_axis"),
        "m2",
        "its covariance",
        tuple(name and f"centroid_{name}" for name in UPPER_TRIANGLE),
    ),
    "node_position_m": Quantity((*NODES, "axis"), "m", "position of the node", ("x_m", "y_m", "z_m")),
    "node_covariance_m2": Quantity((*NODES, "axis", "other_axis"), "m2", "covariance of its position", UPPER_TRIANGLE),
    "semi_axis_m": Quantity(
        (*NODES, "semi_axis"),
        "m",
        "semi-axes of its ellipsoid, the longest first",
        ("semi_a_m", "semi_b_m", "semi_c_m"),
    ),
    "ellipsoid_quaternion": Quantity(
        (*NODES, "component"), "1", "turns the axes x, y, z into the semi-axes", ("qx", "qy", "qz", "qw")
    ),
    "other_position_m": Quantity(
        (*NODES, "axis"), "m", "position in the other shape; nan without one", ("other_x_m", "other_y_m", "other_z_m")
    ),
    "load_n": Quantity(
        (*NODES, "axis"),
        "N",
        "external force, the observable part: zero along a rod that stands on an anchor; nan at anchors",
        ("fx_n", "fy_n", "fz_n"),
    ),
    "load_sigma_n": Quantity(NODES, "N", "its standard deviation, rms over observable directions; inf at anchors"),
    "contact_probability": Quantity(NODES, "1", "probability that the floor carries the node"),
    "length_m": Quantity(TENDONS, "m", "measured length; nan where it was not measured"),
    "sigma_m": Quantity(TENDONS, "m", "its standard deviation; inf for a tendon that was left out"),
    "mode": Quantity(TENDONS, "1", "how the tendon is strained", codes=codes_of(Mode)),
    "flags": Quantity(TENDONS, "1", "what is wrong with the reading", codes=codes_of(Flag), bits=True),
    "predicted_m": Quantity(TENDONS, "m", "length in the estimated shape"),
    "innovation_sigma_m": Quantity(TENDONS, "m", "standard deviation of measured minus predicted length"),
    "drift": Quantity(TENDONS, "1", "relative change of resistance without strain that was taken off"),
    "drift_sigma": Quantity(TENDONS, "1", "its standard deviation"),
    "rods": Quantity(("rod", "end"), "1", "the nodes of each rod, numbered from 0"),
    "rod_length_m": Quantity(("rod",), "m", "length of the rod"),
    "tendons": Quantity(("tendon", "end"), "1", "the nodes of each tendon, numbered from 0"),
    "natural_length_m": Quantity(("tendon",), "m", "length of the tendon without strain"),
    "is_anchor": Quantity(("node",), "1", "1 for a node of known position, else 0"),
}
"""The quantities by name. Which of them a run has depends on what was known of it."""
