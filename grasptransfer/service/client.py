"""Client of `grasptransfer serve`. It needs pyzmq and msgpack alone: this file may be copied anywhere.

    with Client("tcp://127.0.0.1:5556") as client:
        answer = client.infer(open("mug.jpg", "rb").read(), pose, "mug", camera=[fx, fy, cx, cy])
        for grasp in answer["grasps"]:
            print(grasp["name"], grasp["score"], grasp["usable"], grasp["reason"])

Poses are 4x4 nested lists (or arrays) in metres with OpenCV camera axes; `camera_from_gripper` in the answer
is where the TCP goes. Lengths are metres throughout.
"""

import msgpack
import zmq

DEFAULT_ADDRESS = "tcp://127.0.0.1:5556"


class ServiceError(RuntimeError):
    """The service refused a request; the message names the argument, its value and the choices.

    Args:
        kind: name of the error in `grasptransfer.errors`, or "InternalError".
    """

    def __init__(self, message, kind):
        super().__init__(message)
        self.kind = kind


class Client:
    """A connection to the service; not to be shared by threads.

    Args:
        address: of the service.
        timeout: seconds that an answer may take. The first request of a category loads its network.
    """

    def __init__(self, address=DEFAULT_ADDRESS, timeout=60.0):
        self.address, self.timeout = address, timeout
        self._context = zmq.Context()
        self._socket = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """End the connection."""
        self._disconnect()
        self._context.term()

    def health(self):
        """Whether the service answers: a mapping with `version` and `requests`."""
        return self._ask({"action": "health"})

    def metadata(self):
        """Categories, grippers and estimators that the service offers, and the keys that `infer` takes."""
        return self._ask({"action": "metadata"})

    def infer(self, image, pose, category, **options):
        """Transfer the grasps of a category to the object in a picture.

        Args:
            image: content of a JPEG or PNG file (bytes), or a uint8 array (h, w, 3) RGB.
            pose: (4, 4) `camera_from_object`, OpenCV axes [m].
            category: name.
            options: any other key of `metadata()["infer"]`, such as camera, gripper, box or scene.

        Raises:
            ServiceError: the request was refused.
            TimeoutError: no answer in time.
        """
        request = {"image": image, "pose": pose, "category": category, **options}
        return self._ask({"action": "infer", **{key: _plain(value) for key, value in request.items()}})

    def _ask(self, request):
        socket = self._connect()
        socket.send(msgpack.Packer().pack(request))
        if not socket.poll(int(1000 * self.timeout)):
            self._disconnect()  # A socket that waits for an answer cannot ask again.
            raise TimeoutError(f"{self.address} gave no answer within {self.timeout:g} s")
        answer = msgpack.unpackb(socket.recv())
        if not answer["ok"]:
            raise ServiceError(answer["error"], answer["kind"])
        return answer

    def _connect(self):
        if self._socket is None:
            self._socket = self._context.socket(zmq.REQ)
            self._socket.setsockopt(zmq.LINGER, 0)
            self._socket.connect(self.address)
        return self._socket

    def _disconnect(self):
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _plain(value):
    """Arrays become their type, shape and bytes; what else msgpack cannot write is left to it."""
    if hasattr(value, "tobytes") and hasattr(value, "dtype"):
        return {"dtype": str(value.dtype), "shape": list(value.shape), "data": value.tobytes()}
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    return value
