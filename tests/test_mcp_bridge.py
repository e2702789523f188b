"""A model's tool calls reach the service and come back, in one process."""

import asyncio
import json

import mcp
import msgpack
import pytest

import grasptransfer as gt
from grasptransfer.category import load_category
from grasptransfer.poses import load_pose
from grasptransfer.service.client import Client, ServiceError
from grasptransfer.service.mcp_bridge import bridge
from grasptransfer.service.server import Service
from grasptransfer.service.settings import ServiceSettings

DEMO = load_category("mug").folder / "demo"
CAMERA = gt.Camera.load(DEMO / "camera.yaml")


class Direct(Client):
    """A client without a socket; the network is not what is tested here."""

    def __init__(self):
        super().__init__()
        self._service = Service(ServiceSettings(categories=("mug",)))

    def infer(self, image, pose, category, **options):
        return super().infer(image, pose, category, **{"estimator": "rigid", **options})

    def _ask(self, request):
        answer = msgpack.unpackb(self._service.answer(msgpack.Packer().pack(request)))
        if not answer["ok"]:
            raise ServiceError(answer["error"], answer["kind"])
        return answer


@pytest.fixture(scope="module")
def call():
    server = bridge(Direct(), DEMO)

    def called(tool, **arguments):
        async def ask():
            async with mcp.Client(server) as client:
                if tool is None:
                    return await client.list_tools()
                return await client.call_tool(tool, arguments)

        return asyncio.run(ask())

    return called


def test_the_tools_say_what_they_take(call):
    tools = {tool.name: tool for tool in call(None).tools}
    assert set(tools) == {"health", "metadata", "infer"}
    assert set(tools["infer"].input_schema["required"]) == {"picture", "pose", "category"}


def test_a_model_gets_the_best_grasps_of_a_picture(call):
    assert json.loads(call("health").content[0].text)["version"] == gt.__version__
    pose = load_pose(DEMO / "pose.yaml").tolist()
    camera = [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]
    found = call("infer", picture="picture.png", pose=pose, category="mug", camera=camera, most=2)
    answer = json.loads(found.content[0].text)
    assert not found.is_error
    assert len(answer["grasps"]) == 2 < answer["grasps_in_all"]
    assert answer["grasps"][0]["score"] >= answer["grasps"][1]["score"]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"category": "teapot"}, "unknown category"),
        ({"picture": "../grasps.yaml"}, "below the bridge's folder"),
        ({"picture": "/etc/hostname"}, "below the bridge's folder"),
        ({"picture": "pose.yaml"}, "is no picture"),
        ({"pose": [[1.0]]}, "pose"),
    ],
)
def test_what_is_wrong_is_the_services_own_sentence(call, changed, said):
    pose = load_pose(DEMO / "pose.yaml").tolist()
    found = call("infer", **({"picture": "picture.png", "pose": pose, "category": "mug"} | changed))
    assert found.is_error
    assert said in found.content[0].text
