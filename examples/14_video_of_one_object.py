"""Follow one object through a video: what each picture leaves known is the prior of the next.

The frames lie in a folder, with one pose file for all of them: each frame's name and `camera_from_object`, as
a camera on a moving arm knows it. The first pose was estimated, and is 2 cm wrong, so all are wrong by the
same. `GraspTransfer.track()` carries pose and shape on; the more sides are seen, the surer both become.
Writes `video/*.png`, `video/poses.yaml` and `video.html`: Look at video.html

Usage: python examples/14_video_of_one_object.py [--quick]
"""

import sys
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

import grasptransfer as gt
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import look_at
from grasptransfer.frames import invert

CAMERA = gt.Camera.from_fov(640, 480, np.deg2rad(60))
INSTANCE = "drill_0029"  # no training saw it


def record(mesh, folder: Path, frames: int) -> np.ndarray:
    """Film the object from a quarter of a circle around it; the true first pose."""
    folder.mkdir(exist_ok=True)
    poses = [look_at(0.7, azimuth, 0.5) for azimuth in np.linspace(0.6, 2.2, frames)]
    given = poses[0].copy()
    given[:3, 3] += [0.005, -0.003, 0.02]
    entries = {}
    with Renderer() as renderer:
        for number, pose in enumerate(poses):
            picture = renderer.render(mesh, CAMERA, pose)
            name = f"{number:03d}.png"
            Image.fromarray(picture.over(np.full((480, 640, 3), 120, np.uint8))).save(folder / name)
            entries[name] = {"camera_from_object": (pose @ invert(poses[0]) @ given).tolist()}
    (folder / "poses.yaml").write_text(yaml.safe_dump(entries))
    return poses[0]


def main():
    folder = Path("video")
    flow = gt.GraspTransfer("drill")
    first = record(flow.category.instance_scene(INSTANCE), folder, 2 if "--quick" in sys.argv else 8)

    track = flow.track(views="moved camera", pose_noise=(0.001, 0.2))  # of the arm, from frame to frame
    start, result = None, None
    for frame in sorted(folder.glob("*.png")):
        pose = gt.load_pose(folder / "poses.yaml", image=frame)
        result = track.transfer(frame, pose, camera=CAMERA)
        start = pose if start is None else start
        # Where the object was in the first frame, by what is known now.
        in_first = start @ invert(pose) @ result.camera_from_object
        off = np.linalg.norm(in_first[:3, 3] - first[:3, 3])
        assert result.latent_covariance is not None
        unknown = np.sqrt(np.trace(result.latent_covariance[:5, :5]) / 5)
        best = result.grasps[0]
        print(f"{frame.name}: pose off by {1e3 * off:4.1f} mm, shape unsure to {unknown:.2f} sigma, "
              f"best grasp {best.name} {best.score:.2f}")  # fmt: skip
    if result is not None:
        print(f"Look at {result.report('video.html')}")


if __name__ == "__main__":
    main()
