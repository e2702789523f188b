"""A bridge from the Model Context Protocol to `grasptransfer serve`: a language model may ask for grasps.

It hands on requests and answers; what is wrong with a request is the service's own sentence. Pictures are
read below one folder only. Needs the extra `mcp`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcp.server import MCPServer
from mcp.server.mcpserver.exceptions import ToolError

import grasptransfer
from grasptransfer.errors import SettingsError
from grasptransfer.service.client import DEFAULT_ADDRESS, Client, ServiceError

MOST = 5  # grasps of an answer: a model reads every number
ABOUT = (
    "Grasps for an object of a known category in a picture. Poses are 4x4 matrices in metres: "
    "camera_from_object with OpenCV axes (x right, y down, z forward); the object's z is up and its +x its "
    "front. In the answer, camera_from_gripper says where the point between the gripper's pads goes. Ask "
    "metadata first."
)


@dataclass(frozen=True)
class BridgeSettings:
    """What is asked, and what may be read for it.

    Args:
        folder: folder whose pictures may be asked about, and those below it.
        address: of the running service.
        timeout: seconds that an answer may take.

    Raises:
        SettingsError: there is no such folder.
    """

    folder: Path = Path()
    address: str = DEFAULT_ADDRESS
    timeout: float = 60.0

    def __post_init__(self):
        if not self.folder.is_dir():
            raise SettingsError("is no folder", path=self.folder, key="folder")


class Tools:
    """What a model may call.

    Args:
        service: that is asked.
        folder: whose pictures may be read.
    """

    def __init__(self, service: Client, folder: Path):
        self._service, self._folder = service, folder

    def health(self) -> dict[str, Any]:
        """Whether the grasp service answers, and its version."""
        return _answered(self._service.health)

    def metadata(self) -> dict[str, Any]:
        """Categories, grippers and estimators on offer, and the frames of all poses."""
        return _answered(self._service.metadata)

    def infer(
        self,
        picture: str,
        pose: list[list[float]],
        category: str,
        *,
        camera: list[float] | None = None,
        box: list[float] | None = None,
        gripper: str | None = None,
        most: int = MOST,
    ) -> dict[str, Any]:
        """Grasps for the object of a category in a picture, best first, each with score and reason.

        Args:
            picture: path of a JPEG or PNG file below the bridge's folder.
            pose: camera_from_object, 4x4, metres, OpenCV axes.
            category: one that metadata lists.
            camera: [fx, fy, cx, cy] in pixels; without it 60 degrees horizontal field of view.
            box: [u0, v0, u1, v1] around the object in pixels.
            gripper: one that metadata lists.
            most: grasps in the answer.
        """
        content = _picture(self._folder, picture)
        given = {"camera": camera, "box": box, "gripper": gripper}
        options = {name: value for name, value in given.items() if value is not None}
        answer = _answered(lambda: self._service.infer(content, pose, category, **options))
        return answer | {"grasps": answer["grasps"][: max(most, 0)], "grasps_in_all": len(answer["grasps"])}


def bridge(service: Client, folder: Path) -> MCPServer:
    """The server with its tools; arguments as of `Tools`."""
    server = MCPServer("grasptransfer", instructions=ABOUT, version=grasptransfer.__version__)
    tools = Tools(service, folder)
    for tool in (tools.health, tools.metadata, tools.infer):
        server.add_tool(tool)
    return server


def serve_bridge(settings: BridgeSettings) -> None:
    """Answer a model's tool calls on standard input and output until it closes them."""
    with Client(settings.address, settings.timeout) as client:
        bridge(client, settings.folder).run("stdio")


def _picture(folder: Path, name: str) -> bytes:
    path = (folder / name).resolve()  # symbolic links are followed before it is compared
    if not path.is_relative_to(folder.resolve()) or not path.is_file():
        raise ToolError(f"picture: is no file below the bridge's folder (got {name!r})")
    return path.read_bytes()


def _answered(ask: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    try:
        return ask()
    except (ServiceError, TimeoutError) as error:
        raise ToolError(str(error)) from error
