"""Build a category from point clouds, and compare its settings with the predecessor's.

The folder holds clouds in one frame, in metres, below `train/` and `test/`: for instance the drills that
github:AIS-Bonn/shape_registration publishes (datasets/Drills/pcd; there +y is the front). Two categories are
built from them: with the settings that the build chooses itself, and with those published with these
drills: CPD in raw metres with beta = lambda = 1, and five principal components of the weights. The fit of
each shape space to the full test clouds is measured in the same run.

Usage: python examples/08_settings_from_clouds.py FOLDER [--front +y] [--out DIR]
"""

import argparse
from pathlib import Path

import numpy as np

from grasptransfer.workshop.building import BuildSettings, CategoryBuild, build_category
from grasptransfer.workshop.building.category_page import category_page


def main(arguments: list[str] | None = None) -> dict[str, float]:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="with train/ and test/")
    parser.add_argument("--front", default="+x", help="axis of the files that is the front")
    parser.add_argument("--out", type=Path, default=Path("categories"), help="folder to write into")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args(arguments)
    shared = {"meshes": given.folder, "front": given.front, "workers": given.workers, "overwrite": True}

    chosen = build_category(BuildSettings("chosen", out=given.out / "chosen", **shared))
    category_page(chosen, given.out / "chosen" / "category.html")
    raw_settings = BuildSettings("raw_metres", out=given.out / "raw_metres", **shared, **raw_metres(chosen))
    raw = build_category(raw_settings)

    print(f"{'E [1e-6 m^2]':24s} {'undeformed':>10s} {'raw metres':>10s} {'chosen':>10s}")
    for one, other in zip(chosen.registrations, raw.registrations, strict=True):
        if one.test:
            errors = (one.before.error, other.fitted_error, one.fitted_error)
            print(f"{one.name:24s} " + " ".join(f"{1e6 * error:10.1f}" for error in errors))
    means = {"raw metres": mean_error(raw), "chosen": mean_error(chosen)}
    settings = chosen.category.settings
    print(f"{'mean':24s} {'':10s} {means['raw metres']:10.1f} {means['chosen']:10.1f}")
    print(
        f"canonical model {chosen.canonical}; beta {settings.beta:g}, lambda {settings.lam:g}, "
        f"{settings.modes} modes, flexibility {settings.flexibility:g}"
    )
    return means


def raw_metres(build: CategoryBuild) -> dict:
    """Beta 1 and lambda 1 in metres, in the units that `BuildSettings` takes, with the same canonical."""
    # W in metres is `scale` times W in normalised units, so its bending counts scale^2 times as much.
    scale = build.category.shape_space.scale
    modes = min(5, len(build.category.train) - 1)
    settings = {"beta": 1 / scale, "lam": scale**2, "modes": modes, "metric": "W", "flexibility": 0.0}
    return {**settings, "canonical": build.canonical}


def mean_error(build: CategoryBuild) -> float:
    """Mean E of the shape space fitted to the test clouds [1e-6 m^2]."""
    return 1e6 * float(np.mean([one.fitted_error for one in build.registrations if one.test]))


if __name__ == "__main__":
    main()
