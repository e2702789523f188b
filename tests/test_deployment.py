"""The container file and the ROS 2 node: what they name is there, and the node's code runs without ROS."""

import json
import py_compile
import re
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from grasptransfer.cli.main import COMMANDS, GROUPS
from grasptransfer.cli.parsing import parsed

ROOT = Path(__file__).parent.parent
NODE = ROOT / "examples" / "ros2" / "grasp_node.py"
DOCKERFILE = (ROOT / "Dockerfile").read_text()


def test_the_container_copies_what_exists_and_starts_a_command_that_exists():
    copied = re.findall(r"^COPY (?!--from)(.+) \S+$", DOCKERFILE, flags=re.M)
    assert copied
    for name in " ".join(copied).split():
        assert (ROOT / name).exists(), name
    (command,) = re.findall(r"^CMD (\[.+\])$", DOCKERFILE, flags=re.M)
    program, *arguments = json.loads(command)
    assert program == "grasptransfer"
    assert callable(parsed(arguments, COMMANDS, GROUPS))


def test_the_container_runs_as_a_user_without_rights_and_says_whether_it_is_well():
    last = DOCKERFILE.rsplit("FROM ", 1)[1]
    assert re.search(r"^USER [1-9]\d+$", last, flags=re.M)
    (check,) = re.findall(r"^ +CMD (\[.+\])$", last, flags=re.M)
    python, flag, code = json.loads(check)
    assert (python, flag) == ("python", "-c")
    compile(code, "HEALTHCHECK", "exec")


class _Message(SimpleNamespace):
    """Any ROS message: fields as they are given, poses at the origin."""

    def __init__(self, **fields):
        place = {"position": SimpleNamespace(x=0.0, y=0.0, z=0.0)}
        super().__init__(**(place | {"orientation": SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)} | fields))


class _Node:
    def __init__(self, name):
        self.said = []

    def declare_parameter(self, name, value):
        return SimpleNamespace(value=value)

    def create_subscription(self, *_):
        pass

    def create_publisher(self, kind, topic, depth):
        sent = []
        return SimpleNamespace(publish=sent.append, sent=sent)

    def get_logger(self):
        return SimpleNamespace(info=self.said.append, warning=self.said.append, error=self.said.append)


@pytest.fixture
def node(monkeypatch):
    """The module of the node, on a ROS that only records."""
    names = {
        "rclpy": {"init": None, "spin": None},
        "rclpy.node": {"Node": _Node},
        "rclpy.qos": {"qos_profile_sensor_data": 1},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"Pose": _Message, "PoseArray": _Message, "PoseStamped": _Message},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"CameraInfo": _Message, "Image": _Message},
    }
    for name, content in names.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    return runpy.run_path(str(NODE))


def test_the_node_compiles(tmp_path):
    py_compile.compile(str(NODE), cfile=str(tmp_path / "node.pyc"), doraise=True)


def test_poses_survive_the_way_through_ros(node):
    turns = [*Rotation.random(40, rng=np.random.default_rng(0))]
    turns += [*Rotation.from_euler("xyz", np.eye(3) * np.pi)]
    for turn in turns:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn.as_matrix(), (0.1, -0.2, 0.7)
        np.testing.assert_allclose(node["matrix_of"](node["pose_of"](matrix)), matrix, atol=1e-9)


def test_a_pose_asks_about_the_last_picture_and_the_best_grasp_is_published(node):
    one = node["GraspNode"]()
    asked = []

    def infer(image, pose, category, **options):
        asked.append((image, category, options))
        grasp = {"camera_from_gripper": np.eye(4).tolist()}
        return {"grasps": [grasp | {"usable": True}, grasp | {"usable": False}], "advice": "Well."}

    one.client = SimpleNamespace(infer=infer)
    pose = _Message(header="camera", pose=_Message())
    one.on_pose(pose)
    assert one.said == ["no picture or no camera_info yet"]
    blue = np.zeros((2, 4, 3), np.uint8)
    blue[..., 0] = 255
    data = np.hstack([blue.reshape(2, 12), np.zeros((2, 4), np.uint8)])  # rows are padded to 16 bytes
    one.on_image(_Message(encoding="bgr8", height=2, width=4, step=16, data=data.tobytes()))
    one.on_info(_Message(k=[500.0, 0, 2.0, 0, 510.0, 1.0, 0, 0, 1]))
    one.on_pose(pose)
    image, category, options = asked[0]
    assert (image[0, 0].tolist(), category) == ([0, 0, 255], "mug")
    assert options == {"camera": [500.0, 510.0, 2.0, 1.0], "gripper": "panda"}
    assert len(one.grasps.sent[0].poses) == 1
    assert one.best.sent[0].header == "camera"
    one.on_image(_Message(encoding="mono8"))
    one.on_pose(pose)
    assert "encoding must be rgb8 or bgr8" in one.said[-1]
