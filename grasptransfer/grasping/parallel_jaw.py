"""A plain parallel-jaw gripper from a few numbers, written as a URDF and a YAML to load."""

from dataclasses import dataclass
from pathlib import Path

from grasptransfer.errors import GripperError
from grasptransfer.files import replacing

DENSITY = 1500.0  # kg/m3: a housing of aluminium, half hollow


@dataclass(frozen=True)
class ParallelJaw:
    """Dimensions of a parallel-jaw gripper; base at the back of its palm, closing along x.

    Args:
        name: its name, also of the files.
        max_opening: largest distance between the pads [m].
        finger_length: distance from the palm to the finger tips [m].
        finger_width: along TCP y [m].
        finger_thickness: along TCP x [m].
        pad_height: height of the flat pad at the tip of each finger [m].
        palm_size: palm along x, y, z [m].
        force_limit: largest grip force [N].
    """

    name: str = "parallel_jaw"
    max_opening: float = 0.10
    finger_length: float = 0.065
    finger_width: float = 0.020
    finger_thickness: float = 0.010
    pad_height: float = 0.024
    palm_size: tuple[float, float, float] = (0.14, 0.05, 0.07)
    force_limit: float = 60.0

    def __post_init__(self):
        for key, value in vars(self).items():
            numbers = value if isinstance(value, tuple) else (value,)
            if key != "name" and min(numbers) <= 0:
                raise GripperError("must be positive", key=key, value=value)
        if self.pad_height > self.finger_length:
            raise GripperError("must not exceed finger_length", key="pad_height", value=self.pad_height)
        if self.max_opening > 1:
            raise GripperError("must be in metres", key="max_opening", value=self.max_opening)

    def write(self, folder: str | Path) -> Path:
        """Write `<name>.urdf` and `<name>.yaml` into a folder; the YAML's path is for `load_gripper`."""
        folder = Path(folder)
        for suffix, text in ((".urdf", self._urdf()), (".yaml", self._yaml())):
            with replacing(folder / f"{self.name}{suffix}") as temporary:
                temporary.write_text(text)
        return folder / f"{self.name}.yaml"

    def _yaml(self) -> str:
        palm = self.palm_size[2]
        centre = palm + self.finger_length - self.pad_height / 2
        pad = f"centre: [0, 0, {centre:g}], size: [{self.finger_width:g}, {self.pad_height:g}]"
        return f"""\
# A plain parallel-jaw gripper. The palm's back is the base; TCP and base axes agree.
name: {self.name}
urdf: {self.name}.urdf
base_link: palm
base_from_tcp:
  position: [0, 0, {centre:g}]
  orientation: {{w: 1, xyz: [0, 0, 0]}}
joints:
  finger_low_joint: {{ratio: 1}}
  finger_high_joint: {{ratio: 1}}
opening: [0, {self.max_opening:g}]
force_limit: {self.force_limit:g}
pads:
  - {{link: finger_low, {pad}}}
  - {{link: finger_high, {pad}}}
"""

    def _urdf(self) -> str:
        x, y, z = self.palm_size
        length, width, thickness = self.finger_length, self.finger_width, self.finger_thickness
        palm = _link("palm", (x, y, z), (0, 0, z / 2))
        fingers = [
            _link(name, (thickness, width, length), (side * thickness / 2, 0, z + length / 2))
            + _joint(name, side, self.max_opening / 2, self.force_limit)
            for name, side in (("finger_low", -1), ("finger_high", 1))
        ]
        return f'<?xml version="1.0"?>\n<robot name="{self.name}">\n{palm}{"".join(fingers)}</robot>\n'


def _link(name: str, size: tuple[float, float, float], centre: tuple[float, float, float]) -> str:
    x, y, z = size
    mass = DENSITY * x * y * z
    ixx, iyy, izz = (mass / 12 * (a * a + b * b) for a, b in ((y, z), (x, z), (x, y)))
    origin = f'<origin xyz="{centre[0]:g} {centre[1]:g} {centre[2]:g}"/>'
    box = f'{origin}<geometry><box size="{x:g} {y:g} {z:g}"/></geometry>'
    return f"""\
  <link name="{name}">
    <inertial>
      {origin}
      <mass value="{mass:.4g}"/>
      <inertia ixx="{ixx:.4g}" iyy="{iyy:.4g}" izz="{izz:.4g}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual>{box}</visual>
    <collision>{box}</collision>
  </link>
"""


def _joint(link: str, side: int, travel: float, effort: float) -> str:
    return f"""\
  <joint name="{link}_joint" type="prismatic">
    <parent link="palm"/>
    <child link="{link}"/>
    <origin xyz="0 0 0"/>
    <axis xyz="{side} 0 0"/>
    <limit lower="0" upper="{travel:g}" effort="{effort:g}" velocity="0.2"/>
  </joint>
"""
