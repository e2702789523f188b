"""The service: one process that keeps what transfers need warm, and answers one request after the other.

A request is a msgpack mapping with `action`: `health`, `metadata` or `infer` (`requests.py` lists its keys).
An answer is a mapping with `ok`. Where it is false, `error` is one sentence with the argument, its value and
the choices, and `kind` the name of the error. The answer to `infer` holds what `result.yaml` holds: status,
advice, category score, pose, and every grasp, best first, with its score, status and reason.
"""

import logging
import signal
import threading
from collections import OrderedDict
from collections.abc import Callable, Collection

import msgpack
import numpy as np
import zmq

import grasptransfer
from grasptransfer.category import list_categories
from grasptransfer.errors import GraspTransferError, SettingsError
from grasptransfer.grasping import list_grippers
from grasptransfer.report.result_files import as_data
from grasptransfer.result import TransferResult
from grasptransfer.service import requests
from grasptransfer.service.settings import ServiceSettings
from grasptransfer.transfer import ESTIMATORS, GraspTransfer

FRAMES = "camera: OpenCV axes; object: z up, +x its front; gripper: the TCP, +z approach, +x closing"
POLL_MS = 200  # how soon the service notices that it is asked to stop
logger = logging.getLogger(__name__)


class Service:
    """Answers requests; without sockets, so that it can be tested alone."""

    def __init__(self, settings: ServiceSettings):
        self.settings = settings
        self.categories = settings.categories or tuple(list_categories())
        self.grippers = settings.grippers or ("panda", *(n for n in list_grippers() if n != "panda"))
        self.requests = 0
        self._flows: OrderedDict[tuple, GraspTransfer] = OrderedDict()

    def answer(self, message: bytes) -> bytes:
        """The answer to one message, whatever it holds."""
        self.requests += 1
        try:
            reply = self._answer(_unpacked(message))
        except GraspTransferError as error:
            reply = {"ok": False, "kind": type(error).__name__, "error": str(error)}
        except Exception:  # A fault of ours must not end the service for everybody else: it is logged whole.
            logger.exception("a request failed")
            reply = {
                "ok": False,
                "kind": "InternalError",
                "error": "the service failed on this request; its log says where",
            }
        return msgpack.Packer().pack(reply)

    def _answer(self, request: dict) -> dict:
        action = request.pop("action", None)
        if action == "infer":
            return self._infer(request)
        if action not in requests.ACTIONS:
            raise SettingsError("unknown action", key="action", value=action, choices=requests.ACTIONS)
        requests.check_keys(request, (), (), action)
        about = {"ok": True, "name": "grasptransfer", "version": grasptransfer.__version__}
        if action == "health":
            return about | {"requests": self.requests}
        return about | {
            "categories": list(self.categories),
            "grippers": list(self.grippers),
            "estimators": list(ESTIMATORS),
            "infer": {"required": list(requests.REQUIRED), "optional": list(requests.OPTIONAL)},
            "frames": FRAMES,
            "length_unit": "m",
        }

    def _infer(self, request: dict) -> dict:
        requests.check_keys(request, (*requests.REQUIRED, *requests.OPTIONAL), requests.REQUIRED, "infer")
        image = requests.picture(request["image"])
        arrays = {
            key: requests.array(request[key], key)
            for key in ("box", "mask", "depth", "world_from_camera")
            if request.get(key) is not None
        }
        height, width = image.shape[:2]
        flow = self._flow(
            _one_of(request["category"], self.categories, "category"),
            _one_of(request.get("gripper") or self.grippers[0], self.grippers, "gripper"),
            _one_of(request.get("estimator") or "rgb", tuple(ESTIMATORS), "estimator"),
            bool(request.get("refine_pose", True)),
            request.get("seed", 0),
        )
        result = flow.transfer(
            image,
            requests.array(request["pose"], "pose"),
            camera=requests.camera_of(request.get("camera"), width, height),
            box=arrays.get("box"),
            mask=arrays.get("mask"),
            depth=arrays.get("depth"),
            scene=requests.scene_of(request.get("scene")),
            pose_sigma=request.get("pose_sigma"),
            world_from_camera=arrays.get("world_from_camera"),
        )
        return {"ok": True, **_result(result, mesh=bool(request.get("mesh")))}

    def _flow(self, category: str, gripper: str, estimator: str, refine_pose: bool, seed) -> GraspTransfer:
        key = (category, gripper, estimator, refine_pose, seed)
        if key not in self._flows:
            while len(self._flows) >= self.settings.warm:
                self._flows.popitem(last=False)
            self._flows[key] = GraspTransfer(
                category,
                gripper=gripper,
                estimator=estimator,
                refine_pose=refine_pose,
                device=self.settings.device,
                seed=seed,
            )
        self._flows.move_to_end(key)
        return self._flows[key]


def serve(settings: ServiceSettings, *, on_ready: Callable[[str], None] = lambda line: None) -> None:
    """Answer requests until SIGINT or SIGTERM.

    Args:
        on_ready: called with one line once requests are taken.

    Raises:
        SettingsError: the address cannot be served at.
    """
    service, stop = Service(settings), threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    address = f"tcp://{settings.host}:{settings.port}"
    with zmq.Context() as context, context.socket(zmq.REP) as socket:
        socket.setsockopt(zmq.LINGER, 0)
        socket.setsockopt(zmq.MAXMSGSIZE, settings.largest_mb * 1_000_000)
        try:
            socket.bind(address)
        except zmq.ZMQError as error:
            raise SettingsError(f"cannot be served at: {error}", key="host, port", value=address) from error
        on_ready(f"grasptransfer {grasptransfer.__version__} answers at {address}; Ctrl-C ends it")
        while not stop.is_set():
            if socket.poll(POLL_MS):
                socket.send(service.answer(socket.recv()))


def _unpacked(message: bytes) -> dict:
    try:
        request = msgpack.unpackb(message)
    except (ValueError, TypeError, msgpack.exceptions.UnpackException, RecursionError) as error:
        raise SettingsError("is not msgpack", key="request", value=f"{len(message)} bytes") from error
    if not isinstance(request, dict):
        raise SettingsError("must be a mapping with an action", key="request", value=type(request).__name__)
    return request


def _one_of(value: object, choices: Collection[str], key: str) -> str:
    if not isinstance(value, str) or value not in choices:
        raise SettingsError(f"unknown {key}", key=key, value=value, choices=choices)
    return value


def _result(result: TransferResult, *, mesh: bool) -> dict:
    data = as_data(result)
    data["grasps"] = [{"name": name, **grasp} for name, grasp in data["grasps"].items()]
    if mesh:
        vertices = np.asarray(result.mesh.vertices, np.float32)
        faces = np.asarray(result.mesh.faces, np.int32)
        data["mesh"] = {"vertices": _packed(vertices), "faces": _packed(faces)}
    return data


def _packed(numbers: np.ndarray) -> dict:
    return {"dtype": str(numbers.dtype), "shape": list(numbers.shape), "data": numbers.tobytes()}
