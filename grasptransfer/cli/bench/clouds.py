"""`bench cpd` and `bench latent-fit`: registration of whole clouds, without pictures."""

from functools import partial

from grasptransfer.cli.bench.run import Results, run
from grasptransfer.workshop.benchmark.cpd import CpdSettings, run_cpd_benchmark
from grasptransfer.workshop.benchmark.latent_fit import LatentFitSettings, run_latent_fit_benchmark


def cpd(settings: CpdSettings, results: Results) -> int:
    """Speed, memory and error of CPD against the peers that are installed (pycpd, cycpd, probreg)."""
    return run(partial(run_cpd_benchmark, settings), results)


def latent_fit(settings: LatentFitSettings, results: Results) -> int:
    """Error and time of shape-space fits to whole clouds, against the predecessor's objective."""
    return run(partial(run_latent_fit_benchmark, settings), results)
