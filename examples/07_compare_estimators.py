"""Compare ways to estimate the shape, on one mug that no training saw and whose true shape is known.

`rgb` sees the picture only; `cls` and `cpd` are given a depth picture and the object's mask as well;
`similarity` knows size only, `rigid` nothing. An estimator is any callable `Observation -> ShapeEstimate`:
the true shape is one here. Writes `estimators.png`, the reconstructions side by side: look at it.

Usage: python examples/07_compare_estimators.py [--quick]
"""

import sys
import time

import numpy as np
from PIL import Image

import grasptransfer as gt
from grasptransfer.drawing.contact_sheet import contact_sheet
from grasptransfer.drawing.rendering import Renderer
from grasptransfer.drawing.views import look_at
from grasptransfer.perception.estimate import ShapeEstimate

CAMERA = gt.Camera.from_fov(640, 480, np.deg2rad(50))
POSE = look_at(0.45, np.deg2rad(40), np.deg2rad(30))  # camera_from_object [m]
NAMES = ("rgb", "cls", "cpd", "similarity", "rigid")


def main():
    category = gt.load_category("mug")
    instance = category.test[2]
    truth = category.field(instance)
    names = ("rgb", "cls", "rigid") if "--quick" in sys.argv else NAMES
    with Renderer() as renderer:
        picture = renderer.render(category.instance_scene(instance), CAMERA, POSE)
        image = picture.over(np.full((480, 640, 3), 150, np.uint8))
        estimators = {"the true shape": lambda seen: ShapeEstimate(truth, seen.camera_from_object)}
        estimators |= {name: name for name in names}
        print(f"{'estimator':15s} {'surface error':>14s} {'usable grasps':>14s} {'time':>8s}")
        meshes = []
        for name, estimator in estimators.items():
            flow = gt.GraspTransfer(category, estimator=estimator, refine_pose=False)
            mask, depth = (None, None) if name == "rgb" else (picture.mask, picture.depth)
            start = time.perf_counter()
            result = flow.transfer(image, POSE, camera=CAMERA, mask=mask, depth=depth)
            seconds = time.perf_counter() - start
            # Points of the canonical model: where the estimate puts them, and where they truly are.
            points = np.asarray(category.canonical.vertices)
            error = np.linalg.norm(result.field(points) - truth(points), axis=1)
            rms = 1e3 * np.sqrt(np.mean(error**2))
            usable = f"{len(result.usable)} of {len(result.grasps)}"
            print(f"{name:15s} {rms:11.2f} mm {usable:>14s} {seconds:6.2f} s")
            meshes.append(result.mesh)
        sheet = contact_sheet(meshes, renderer, columns=3)
        Image.fromarray(sheet).save("estimators.png")
    print("Look at estimators.png, in the order of the table: two sides of each reconstruction")


if __name__ == "__main__":
    main()
