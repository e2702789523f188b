"""Small meshes, and the category that is built from them."""

from pathlib import Path

import numpy as np
import trimesh

from grasptransfer.workshop.building import BuildSettings, CategoryBuild, build_category

SMALL = {"control_points": 80, "workers": 1, "beta": 1.0, "lam": 1.0, "modes": 2, "flexibility": 0.0}


def vase(height: float, width: float, lean: float = 0.0) -> trimesh.Trimesh:
    """A turned body with a flag on its +x side, so that it has a front."""
    profile = np.array([[0, 0], [0.6, 0], [1, 0.4], [0.5, 0.9], [0.5, 1], [0, 1]]) * [width / 2, height]
    body = trimesh.creation.revolve(profile, sections=24)
    flag = trimesh.creation.box((0.6 * width, 0.2 * width, 0.2 * height))
    flag.apply_translation([0.7 * width, 0, 0.5 * height])
    both = body + flag
    both.vertices += lean * both.vertices[:, 2:] * [0, 1, 0]
    return both


def cloud(height: float, width: float, count: int = 600) -> np.ndarray:
    """Points of a vase."""
    return np.asarray(trimesh.sample.sample_surface(vase(height, width), count, seed=0)[0])


def write_vases(folder: Path) -> Path:
    """Four instances in as many formats, one of them a cloud, and a fifth; their folder."""
    vase(0.10, 0.050).export(folder / "a.obj")
    vase(0.12, 0.055).export(folder / "b.stl")
    (folder / "c").mkdir()
    vase(0.14, 0.050).export(folder / "c" / "mesh.glb")
    np.savetxt(folder / "d.xyz", cloud(0.13, 0.060))
    vase(0.125, 0.052).export(folder / "e.off")
    return folder


def build_vases(meshes: Path, out: Path, **options) -> CategoryBuild:
    """The category of `write_vases`, its settings given; the fifth instance is for the test."""
    calls = {key: options.pop(key) for key in ("progress", "finish") if key in options}
    return build_category(BuildSettings("vase", meshes, test=("e",), out=out, **SMALL | options), **calls)
