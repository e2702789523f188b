"""One `GraspTransfer` used from many threads, as executors and web servers do."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

import grasptransfer as gt

DEMO = "objects/mug/demo"
BOX = (284, 183, 404, 340)


def test_a_grasp_transfer_gives_the_same_answer_in_every_thread():
    pose, camera = gt.load_pose(f"{DEMO}/pose.yaml"), gt.Camera.load(f"{DEMO}/camera.yaml")
    flow = gt.GraspTransfer("mug")

    def transferred(_):
        return flow.transfer(f"{DEMO}/picture.png", pose, camera=camera, mask=BOX)

    first = transferred(0)
    with ThreadPoolExecutor(3) as pool:
        results = [*pool.map(transferred, range(4)), transferred(0)]
    for result in results:
        assert result.latent is not None
        assert first.latent is not None
        np.testing.assert_allclose(result.latent, first.latent, atol=1e-6)
        assert [grasp.name for grasp in result.grasps] == [grasp.name for grasp in first.grasps]
        assert [grasp.status for grasp in result.grasps] == [grasp.status for grasp in first.grasps]


def test_a_grasp_transfer_may_be_built_in_a_thread_and_used_in_another():
    pose, camera = gt.load_pose(f"{DEMO}/pose.yaml"), gt.Camera.load(f"{DEMO}/camera.yaml")
    with ThreadPoolExecutor(1) as builder, ThreadPoolExecutor(1) as user:
        flow = builder.submit(gt.GraspTransfer, "mug", estimator="rigid").result()
        image = f"{DEMO}/picture.png"
        assert user.submit(flow.transfer, image, pose, camera=camera, mask=BOX).result().grasps
