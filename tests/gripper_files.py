"""Small grippers written on the spot: a palm with two fingers, told apart by what a test changes."""

from pathlib import Path

SIZES = {"palm": (0.04, 0.09, 0.05), "finger": (0.01, 0.006, 0.08)}


def box(size, at=(0, 0, 0), tag="collision"):
    place, lengths = (" ".join(str(value) for value in values) for values in (at, size))
    return f'<{tag}><origin xyz="{place}"/><geometry><box size="{lengths}"/></geometry></{tag}>'


def link(name, *shapes):
    return f'<link name="{name}">{"".join(shapes)}</link>'


def joint(name, parent, child, *, kind="prismatic", axis="0 1 0", at="0 0 0.05", limits=(0, 0.025), more=""):
    limit = (
        "" if limits is None else f'<limit lower="{limits[0]}" upper="{limits[1]}" effort="9" velocity="1"/>'
    )
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/><axis xyz="{axis}"/>{limit}{more}</joint>'
    )


def mimic(leader, ratio: float = 1, offset: float = 0):
    return f'<mimic joint="{leader}" multiplier="{ratio}" offset="{offset}"/>'


PALM = link("palm", box(SIZES["palm"], (0, 0, 0.025)))
FINGERS = {
    name: link(name, box(SIZES["finger"], (0, side * 0.003, 0.04)))
    for name, side in (("left", 1), ("right", -1))
}
LEFT = joint("left_slide", "palm", "left")
RIGHT = joint("right_slide", "palm", "right", axis="0 -1 0", more=mimic("left_slide"))
YAML = """\
name: own
urdf: own.urdf
base_link: palm
base_from_tcp: {position: [0, 0, 0.12], orientation: {w: 0.70710678, xyz: [0, 0, 0.70710678]}}
opening: [0, 0.05]
force_limit: 40
pads:
  - {link: right, centre: [0, 0, 0.07], size: [0.01, 0.02]}
  - {link: left, centre: [0, 0, 0.07], size: [0.01, 0.02]}
"""


def write_gripper(folder, *, palm=PALM, left=LEFT, right=RIGHT, fingers=None, more="", replace=()) -> Path:
    """Write `own.urdf` and `own.yaml`; `replace` holds pairs of text in the YAML and what stands there."""
    links = "".join((fingers or FINGERS).values())
    (folder / "own.urdf").write_text(f'<robot name="own">{palm}{links}{left}{right}{more}</robot>')
    text = YAML
    for old, new in replace:
        assert old in text
        text = text.replace(old, new)
    (folder / "own.yaml").write_text(text)
    return folder / "own.yaml"
