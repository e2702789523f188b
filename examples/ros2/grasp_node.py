"""A ROS 2 node: picture, camera_info and object pose in, grasp poses out, by a running `grasptransfer serve`.

It needs rclpy, numpy, pyzmq and msgpack, and the file `grasptransfer_client.py` beside it; see README.md.

Usage: python3 grasp_node.py --ros-args -p category:=mug -r image:=/camera/color/image_raw
"""

import numpy as np
import rclpy
from geometry_msgs.msg import Pose, PoseArray, PoseStamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image

try:
    from grasptransfer_client import Client, ServiceError
except ImportError:  # where grasptransfer itself is installed
    from grasptransfer.service.client import Client, ServiceError


class GraspNode(Node):
    """Asks for grasps whenever a pose comes, about the last picture."""

    def __init__(self):
        super().__init__("grasptransfer")
        self.category = self.declare_parameter("category", "mug").value
        self.gripper = self.declare_parameter("gripper", "panda").value
        address = self.declare_parameter("address", "tcp://127.0.0.1:5556").value
        self.client = Client(address, timeout=60.0)
        self.image, self.intrinsics = None, None
        self.create_subscription(Image, "image", self.on_image, qos_profile_sensor_data)
        self.create_subscription(CameraInfo, "camera_info", self.on_info, qos_profile_sensor_data)
        self.create_subscription(PoseStamped, "object_pose", self.on_pose, 1)
        self.grasps = self.create_publisher(PoseArray, "grasps", 1)
        self.best = self.create_publisher(PoseStamped, "best_grasp", 1)

    def on_image(self, message):
        self.image = message

    def on_info(self, message):
        k = message.k
        self.intrinsics = [k[0], k[4], k[2], k[5]]

    def on_pose(self, message):
        if self.image is None or self.intrinsics is None:
            self.get_logger().warning("no picture or no camera_info yet")
            return
        try:
            given = {"camera": self.intrinsics, "gripper": self.gripper}
            pose = matrix_of(message.pose)
            answer = self.client.infer(pixels_of(self.image), pose, self.category, **given)
        except (ServiceError, TimeoutError, ValueError) as error:
            self.get_logger().error(str(error))
            return
        usable = [grasp for grasp in answer["grasps"] if grasp["usable"]]
        self.get_logger().info(f"{len(usable)} of {len(answer['grasps'])} grasps usable. {answer['advice']}")
        poses = [pose_of(np.array(grasp["camera_from_gripper"])) for grasp in usable]
        self.grasps.publish(PoseArray(header=message.header, poses=poses))
        if poses:
            self.best.publish(PoseStamped(header=message.header, pose=poses[0]))


def pixels_of(message):
    """(h, w, 3) uint8 RGB of a sensor_msgs/Image."""
    if message.encoding not in ("rgb8", "bgr8"):
        raise ValueError(f"image: encoding must be rgb8 or bgr8 (got {message.encoding!r})")
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
    pixels = rows[:, : 3 * message.width].reshape(message.height, message.width, 3)
    return np.ascontiguousarray(pixels[..., ::-1] if message.encoding == "bgr8" else pixels)


def matrix_of(pose):
    """4x4 of a geometry_msgs/Pose."""
    q, p = pose.orientation, pose.position
    x, y, z, w = np.array([q.x, q.y, q.z, q.w]) / np.linalg.norm([q.x, q.y, q.z, q.w])
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = [p.x, p.y, p.z]
    return matrix


def pose_of(matrix):
    """geometry_msgs/Pose of a 4x4."""
    r, pose = matrix[:3, :3], Pose()
    # The largest of the four squares decides, so that nothing is divided by a small number.
    squares = [1 + np.trace(r), *(1 + 2 * r[i, i] - np.trace(r) for i in range(3))]
    i = int(np.argmax(squares))
    root = np.sqrt(squares[i])
    if i == 0:
        w, (x, y, z) = (
            root / 2,
            np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / (2 * root),
        )
    else:
        a, b, c = i - 1, i % 3, (i + 1) % 3
        axes = np.zeros(3)
        axes[a] = root / 2
        axes[b], axes[c] = (r[b, a] + r[a, b]) / (2 * root), (r[c, a] + r[a, c]) / (2 * root)
        (x, y, z), w = axes, (r[c, b] - r[b, c]) / (2 * root)
    pose.position.x, pose.position.y, pose.position.z = (float(value) for value in matrix[:3, 3])
    q = pose.orientation
    q.x, q.y, q.z, q.w = (float(value) for value in (x, y, z, w))
    return pose


def main():
    rclpy.init()
    rclpy.spin(GraspNode())


if __name__ == "__main__":
    main()
