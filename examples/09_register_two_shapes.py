"""Register two drills that share nothing but their category, and warp a whole mesh by the field.

Each cloud is a random sample of its own surface: no point of one has a counterpart in the other.

Writes `register_two_shapes.png`: look at it.

Usage: python examples/09_register_two_shapes.py
"""

import matplotlib.pyplot as plt
import trimesh

from grasptransfer.registration import cpd
from grasptransfer.workshop.objects import canonical, sample

POINTS = 1500
ORANGE, GREY = "#e8590c", "#495057"


def main():
    mesh, other = canonical("drill").mesh(), sample("drill", 0).mesh()
    source, target = (trimesh.sample.sample_surface(one, POINTS, seed=0)[0] for one in (mesh, other))
    result = cpd(source, target, beta=1.0)
    print(f"{result.status.value} after {result.iterations} iterations: {result.status.advice}")
    warped = trimesh.Trimesh(result.field(mesh.vertices), mesh.faces, process=False)
    for name, one in (("before", mesh), ("after", warped)):
        # Distances of points on the target, not of vertices, which are dense where the surface bends.
        distance = trimesh.proximity.closest_point(one, target[:500])[1]
        print(f"{name}: {1e3 * (distance**2).mean() ** 0.5:.1f} mm RMS from the target to the source")
    draw(source, target, result(source))


def draw(source, target, moved):
    """Both clouds from the side: as given, the path of each sixth point, and registered."""
    figure, axes = plt.subplots(1, 3, figsize=(10, 3.9), sharex=True, sharey=True, layout="constrained")
    for axis, points, title in zip(
        axes, (source, None, moved), ("source and target", "displacement", "registered"), strict=True
    ):
        axis.scatter(*target[:, [0, 2]].T, s=4, color=GREY, alpha=0.35, linewidths=0, label="target")
        if points is None:
            start, step = source[::6], (moved - source)[::6]
            axis.quiver(
                *start[:, [0, 2]].T, *step[:, [0, 2]].T, color=ORANGE, angles="xy", scale_units="xy", scale=1
            )
        else:
            axis.scatter(*points[:, [0, 2]].T, s=4, color=ORANGE, alpha=0.6, linewidths=0, label="source")
        axis.set_title(title)
        axis.set_aspect("equal")
        axis.axis("off")
    axes[2].legend(loc="center left", frameon=False, markerscale=4)
    figure.savefig("register_two_shapes.png", dpi=100)
    print("Look at register_two_shapes.png")


if __name__ == "__main__":
    main()
