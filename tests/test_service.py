"""The service and its client, in another process and alone."""

import signal
import socket
import subprocess
import sys

import msgpack
import numpy as np
import pytest
from seen_mug import CAMERA, POSE, see_mug

import grasptransfer as gt
from grasptransfer.errors import SettingsError
from grasptransfer.service.client import Client, ServiceError
from grasptransfer.service.server import Service
from grasptransfer.service.settings import ServiceSettings

PATIENCE = 300.0  # s: no answer takes so long on any machine.
INTRINSICS = [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy]


@pytest.fixture(scope="module")
def seen():
    return see_mug(gt.load_category("mug"))


@pytest.fixture(scope="module")
def service():
    return Service(ServiceSettings(categories=("mug",)))


@pytest.fixture(scope="module")
def address():
    for _ in range(10):
        port = _free_port()
        command = [sys.executable, "-m", "grasptransfer", "serve", "--port", str(port), "--largest-mb", "8"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            if "answers at" not in process.stdout.readline():
                process.kill()
                continue  # Another process has taken the port in the meantime.
            yield f"tcp://127.0.0.1:{port}"
            process.send_signal(signal.SIGTERM)
            assert process.wait(PATIENCE) == 0
        return
    pytest.fail("the service did not start")


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def asked(service: Service, **request) -> dict:
    message = msgpack.packb(request)
    assert message is not None
    return msgpack.unpackb(service.answer(message))


def test_a_client_in_another_process_gets_the_grasps_that_the_library_gives(address, seen):
    image, rendered = seen
    rows, columns = np.nonzero(rendered.mask)
    box = [float(side) for side in (columns.min(), rows.min(), columns.max(), rows.max())]
    direct = gt.transfer_grasps(image, POSE, "mug", camera=CAMERA, mask=tuple(box), estimator="rigid")
    with Client(address, timeout=PATIENCE) as client:
        assert client.health()["version"] == gt.__version__
        assert "mug" in client.metadata()["categories"]
        answer = client.infer(image, POSE, "mug", camera=INTRINSICS, box=box, estimator="rigid", mesh=True)
    assert [grasp["name"] for grasp in answer["grasps"]] == [grasp.name for grasp in direct.grasps]
    for given, wanted in zip(answer["grasps"], direct.grasps, strict=True):
        np.testing.assert_allclose(given["camera_from_gripper"], wanted.camera_from_gripper, atol=1e-6)
        assert given["score"] == pytest.approx(wanted.score, abs=1e-3)
        assert given["reason"] == wanted.reason
    vertices = answer["mesh"]["vertices"]
    assert np.frombuffer(vertices["data"], vertices["dtype"]).reshape(vertices["shape"]).shape == (
        direct.mesh.vertices.shape
    )


def test_one_bad_request_in_ten_is_answered_and_disturbs_nobody(address, seen):
    with Client(address, timeout=PATIENCE) as client:
        for number in range(100):
            if number % 10:
                assert client.health()["ok"]
                continue
            with pytest.raises(ServiceError) as caught:
                client.infer(seen[0], np.eye(3), "teapot")
            assert caught.value.kind == "SettingsError"
            assert "spray_bottle" in str(caught.value)


def test_a_request_that_is_too_large_is_not_taken_and_the_service_lives_on(address):
    with Client(address, timeout=1.0) as client, pytest.raises(TimeoutError):
        client.infer(b"0" * 9_000_000, POSE, "mug")
    with Client(address, timeout=PATIENCE) as client:
        assert client.health()["ok"]


@pytest.mark.parametrize(
    ("request_", "kind", "said"),
    [
        ({}, "SettingsError", "health, metadata, infer"),
        ({"action": "health", "loud": True}, "SettingsError", "loud"),
        ({"action": "infer"}, "SettingsError", "image"),
        ({"action": "infer", "image": b"no", "pose": [], "category": "mug"}, "ImageError", "picture"),
        ({"action": "infer", "image": b"no", "pose": [], "category": "mug", "x": 1}, "SettingsError", "x"),
    ],
)
def test_a_wrong_request_is_answered_by_argument_and_choices(service, request_, kind, said):
    answer = asked(service, **request_)
    assert not answer["ok"]
    assert answer["kind"] == kind
    assert said in answer["error"]


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("pose", [[1, 2], [3]], "pose"),
        ("pose", np.diag([1, 1, -1, 1]).tolist(), "reflection"),
        ("category", "/etc", "known: mug"),
        ("gripper", "../gripper.yaml", "known: panda"),
        ("estimator", "magic", "rgbd"),
        ("camera", [1, 2, 3], "3x3"),
        ("mask", {"dtype": "bool", "shape": [4, 4], "data": b"123"}, "do not fill"),
        ("mask", {"dtype": "object", "shape": [1], "data": b"1"}, "float64"),
        ("scene", {"obstacles": {"wall": {"mesh": "/etc/passwd"}}}, "scene.obstacles.wall.mesh"),
        ("scene", {"obstacles": {"wall": {"camera_from_obstacle": POSE.tolist()}}}, "vertices"),
        ("seed", -1, "seed"),
    ],
)
def test_a_wrong_value_is_named(service, seen, key, value, said):
    image = {"dtype": "uint8", "shape": list(seen[0].shape), "data": seen[0].tobytes()}
    request = {"image": image, "pose": POSE.tolist(), "category": "mug", "estimator": "rigid", key: value}
    answer = asked(service, action="infer", **request)
    assert not answer["ok"]
    assert answer["kind"] != "InternalError"
    assert said in answer["error"]


@pytest.mark.parametrize("message", [b"", b"\xc1", b"\x01", b"\x92", b"\x81\xa6action" + b"\x91" * 2000])
def test_bytes_that_are_no_request_are_answered(service, message):
    answer = msgpack.unpackb(service.answer(message))
    assert (answer["ok"], answer["kind"]) == (False, "SettingsError")


def test_an_obstacle_in_the_way_is_reported_by_its_name(service, seen):
    image = {"dtype": "uint8", "shape": list(seen[0].shape), "data": seen[0].tobytes()}
    wall = {"box": [0.4, 0.4, 0.4], "camera_from_obstacle": POSE.tolist()}
    answer = asked(
        service,
        action="infer",
        image=image,
        pose=POSE.tolist(),
        category="mug",
        camera=INTRINSICS,
        estimator="rigid",
        scene={"obstacles": {"wall": wall}},
    )
    assert answer["ok"]
    assert not any(grasp["usable"] for grasp in answer["grasps"])
    assert any("wall" in grasp["reason"] for grasp in answer["grasps"])


def test_settings_of_a_service_are_checked():
    with pytest.raises(SettingsError, match="port"):
        ServiceSettings(port=0)


def test_the_client_needs_nothing_of_the_package():
    code = (
        "import sys, runpy; runpy.run_path(sys.argv[1]);"
        "print([m for m in sys.modules if m.split('.')[0] in ('grasptransfer', 'numpy', 'torch')])"
    )
    import grasptransfer.service.client as client

    output = subprocess.run(
        [sys.executable, "-c", code, client.__file__], capture_output=True, text=True, check=True
    )
    assert output.stdout.strip() == "[]"
