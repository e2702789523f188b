"""How near CPD comes to the true correspondences of a category's parametric shapes.

Random shapes of a category share its canonical model's surface, so it is known where each canonical point
truly went. CPD only sees their points. Printed for several kernels and smoothnesses, the best first:
the distance to the truth, and the distance to the surface, which says little about correspondences.

Usage: python examples/10_cpd_against_truth.py [CATEGORY] [--samples 10]
"""

import argparse

from grasptransfer.workshop import objects
from grasptransfer.workshop.building.parametric.canonical_surface import surface_of
from grasptransfer.workshop.building.parametric.cpd_accuracy import cpd_accuracy


def main(arguments: list[str] | None = None):
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("category", nargs="?", default="mug")
    parser.add_argument("--samples", type=int, default=10)
    parser.add_argument("--quick", action="store_true", help="one sample")
    given = parser.parse_args(arguments)
    samples = 1 if given.quick else given.samples
    rows = cpd_accuracy(surface_of(objects.canonical(given.category)), samples=samples)
    print("beta  lambda    mean     p95   [mm]    mean    p95  [% of size]   surface RMS [mm]")
    for row in rows:
        lengths = f"{1000 * row.mean:8.2f}{1000 * row.p95:8.2f}"
        shares = f"{100 * row.mean_share:8.2f}{100 * row.p95_share:7.2f}"
        print(f"{row.beta:4g}{row.lam:8g}{lengths}       {shares}{1000 * row.surface_rms:20.2f}")


if __name__ == "__main__":
    main()
