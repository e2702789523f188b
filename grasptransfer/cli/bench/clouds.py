"""`bench cpd` and `bench latent-fit`: registration of whole clouds, without pictures."""

from functools import partial
from pathlib import Path

from grasptransfer.cli.bench.arguments import Json, Repeats
from grasptransfer.cli.bench.run import run


def cpd(
    *,
    json: Json,
    sizes: tuple[int, ...] = (500, 1000, 2000, 4000, 8000),
    repeats: Repeats = 3,
    longest: float = 100.0,
    seed: int = 0,
) -> int:
    """Speed, memory and error of CPD against the peers that are installed (pycpd, cycpd, probreg).

    Args:
        sizes: points of each cloud.
        longest: a peer that would take more seconds than this is extrapolated.
        seed: of the clouds.
    """
    from grasptransfer.workshop.benchmark.cpd import run_cpd_benchmark

    return run(partial(run_cpd_benchmark, sizes, repeats=repeats, longest=longest, seed=seed), json)


def latent_fit(*, data: Path, json: Json, modes: int = 5, repeats: Repeats = 3) -> int:
    """Error and time of shape-space fits to whole clouds, against the predecessor's objective.

    Args:
        data: folder of clouds (pcd, xyz) in one frame, metres: train/ and test/.
        modes: of the shape space.
    """
    from grasptransfer.workshop.benchmark.latent_fit import LatentFitSettings, run_latent_fit_benchmark

    return run(partial(run_latent_fit_benchmark, LatentFitSettings(data, modes, repeats=repeats)), json)
