"""Speed, memory and error of CPD against its peers: on the same clouds, in one run, taking turns.

All implementations get the same normalised clouds, beta, lambda, no outliers and a forced number of
iterations. The time of a peer that is too slow is extrapolated from its first iterations, and its row says
so.
"""

import importlib.util
import io
import threading
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass

import numpy as np
import psutil
from jaxtyping import Float
from scipy.spatial import KDTree

from grasptransfer.errors import SettingsError
from grasptransfer.jobs import run_fresh
from grasptransfer.options import check_counts
from grasptransfer.registration import PreparedSource, cpd
from grasptransfer.workshop.benchmark.document import document
from grasptransfer.workshop.benchmark.options import Repeats
from grasptransfer.workshop.objects import canonical

OURS = ("grasptransfer", "grasptransfer-numpy")
PEERS = ("pycpd", "cycpd", "probreg")
PROBE = (2, 6)  # Numbers of iterations from which a long run is extrapolated.
UNTOLERANT = 1e-30  # Peers demand a tolerance above 0, though the iterations are forced.


@dataclass(frozen=True)
class CpdSettings:
    """What `run_cpd_benchmark` does.

    Args:
        sizes: numbers of points of the clouds.
        iterations: number of iterations that every implementation is forced to do.
        beta: kernel width, normalised units.
        lam: lambda.
        longest: the time of a peer that would take more seconds than this is extrapolated.
        largest_peer: peers are left out beyond this size, because they need several arrays of all pairs.
        seed: seed of the clouds.
    """

    sizes: tuple[int, ...] = (500, 1000, 2000, 4000, 8000)
    repeats: Repeats = 3
    iterations: int = 150
    beta: float = 2.0
    lam: float = 2.0
    longest: float = 100.0
    largest_peer: int = 4000
    seed: int = 0

    def __post_init__(self):
        if not self.sizes or min(self.sizes) < 10:
            raise SettingsError("must be clouds of at least 10 points", key="sizes", value=self.sizes)
        check_counts(self, "repeats", "iterations")


@dataclass(frozen=True, eq=False)
class Clouds:
    """A pair to register, normalised, and the size of its unit.

    Args:
        source: (n, 3).
        target: (m, 3), another sample of a smoothly warped copy.
        scale: [m].
    """

    source: Float[np.ndarray, "n 3"]
    target: Float[np.ndarray, "m 3"]
    scale: float

    def error(self, moved: Float[np.ndarray, "n 3"]) -> float:
        """The paper's E: mean squared distance from target to nearest moved point [1e-6 m^2]."""
        distances = KDTree(moved).query(self.target)[0]
        return float(np.square(distances * self.scale).mean() * 1e6)


def run_cpd_benchmark(settings: CpdSettings, *, progress: Callable[[int, int], None] | None = None) -> dict:
    """Compare our CPD with each installed peer.

    Args:
        settings: what is measured.
        progress: called with (sizes done, in all).
    """
    seed = settings.seed
    peers = [peer for peer in PEERS if importlib.util.find_spec(peer)]
    # The first run compiles, or loads compiled code.
    _register("grasptransfer", _clouds(60, seed), settings, 2)
    rows: list[dict] = []
    for done, size in enumerate(settings.sizes, 1):
        clouds = _clouds(size, seed)
        names = [*OURS, *(peers if size <= settings.largest_peer else [])]
        rows += _measure(names, clouds, settings)
        if progress:
            progress(done, len(settings.sizes))
    return document("cpd", settings=asdict(settings), rows=rows, summary=_summary(rows, peers))


def _measure(names: list[str], clouds: Clouds, settings: CpdSettings) -> list[dict]:
    """One row for each implementation; full runs take turns."""
    estimates = {name: _estimate(name, clouds, settings) for name in names}
    full = [name for name in names if name in OURS or estimates[name][0] <= settings.longest]
    taken: dict[str, list[np.ndarray]] = {name: [] for name in full}
    errors: dict[str, float] = {}
    for _ in range(settings.repeats):
        for name in full:
            moved, seconds = _timed(name, clouds, settings, settings.iterations)
            taken[name].append(seconds)
            errors[name] = clouds.error(moved)
    rows = []
    for name in names:
        wall, cpu = np.median(taken[name], axis=0) if name in full else estimates[name]
        rows.append(
            {
                "implementation": name,
                "n": len(clouds.source),
                "seconds": float(wall),
                "cpu_seconds": float(cpu),
                "E": errors.get(name),
                "extrapolated": name not in full,
                "all_seconds": [float(seconds[0]) for seconds in taken.get(name, [])],
                "memory_mb": _peak_memory(name, len(clouds.source), settings),
            }
        )
    return rows


def _estimate(name: str, clouds: Clouds, settings: CpdSettings) -> Float[np.ndarray, "2"]:
    """Seconds of a full run, from two short ones."""
    first, second = (_timed(name, clouds, settings, iterations)[1] for iterations in PROBE)
    each = np.maximum(second - first, 0.0) / (PROBE[1] - PROBE[0])
    return second + each * (settings.iterations - PROBE[1])


def _timed(
    name: str, clouds: Clouds, settings: CpdSettings, iterations: int
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "2"]]:
    """Moved points; seconds by the clock, and of all cores together, which other work hardly changes."""
    start = np.array([time.perf_counter(), time.process_time()])
    moved = _register(name, clouds, settings, iterations)
    return moved, np.array([time.perf_counter(), time.process_time()]) - start


def _register(name: str, clouds: Clouds, settings: CpdSettings, iterations: int) -> Float[np.ndarray, "n 3"]:
    """Moved source points, normalised."""
    source, target, beta, lam = clouds.source, clouds.target, settings.beta, settings.lam
    if name in OURS:
        backend = "numpy" if name.endswith("numpy") else "compiled"
        prepared = PreparedSource(source, beta=beta)  # Its preparation counts in every run.
        result = cpd(prepared, target, lam=lam, tolerance=0.0, max_iterations=iterations, backend=backend)
        return result(source)
    if name == "pycpd":
        from pycpd import DeformableRegistration

        options = {"alpha": lam, "beta": beta, "max_iterations": iterations, "tolerance": UNTOLERANT}
        return DeformableRegistration(X=target, Y=source, **options).register()[0]
    if name == "cycpd":
        from cycpd import deformable_registration  # pyright: ignore[reportMissingImports]

        options = {"alpha": lam, "beta": beta, "max_iterations": iterations, "tolerance": UNTOLERANT}
        registration = deformable_registration(X=target, Y=source, verbose=False, **options)
        with redirect_stdout(io.StringIO()):  # The peer prints its timings.
            registration.register(lambda **_: None)
        return np.asarray(registration.TY)
    from probreg import cpd as probreg_cpd  # pyright: ignore[reportMissingImports]

    # Its kernel is exp(-d^2 / (2 beta)).
    result = probreg_cpd.registration_cpd(
        source, target, "nonrigid", w=0.0, maxiter=iterations, tol=UNTOLERANT, beta=beta**2, lmd=lam
    )
    return np.asarray(result.transformation.transform(source))


def _peak_memory(name: str, size: int, settings: CpdSettings) -> float:
    """What three iterations add to the peak memory of a fresh process [MB]."""
    return run_fresh(_peak_memory_here, name, size, settings)


def _peak_memory_here(name: str, size: int, settings: CpdSettings) -> float:
    _register(name, _clouds(60, settings.seed), settings, 2)
    clouds = _clouds(size, settings.seed)
    process = psutil.Process()
    before = peak = process.memory_info().rss
    finished = threading.Event()

    def watch():
        nonlocal peak
        while not finished.wait(0.001):
            peak = max(peak, process.memory_info().rss)

    watcher = threading.Thread(target=watch)
    watcher.start()
    _register(name, clouds, settings, 3)
    finished.set()
    watcher.join()
    return (peak - before) / 2**20


def _summary(rows: list[dict], peers: list[str]) -> dict:
    by_key = {(row["implementation"], row["n"]): row for row in rows}
    summary: dict[str, float | str] = {}
    for name, size in by_key:
        if name != "grasptransfer":
            continue
        ours, plain = by_key[name, size], by_key["grasptransfer-numpy", size]
        summary[f"seconds_n{size}"] = ours["seconds"]
        summary[f"seconds_numpy_n{size}"] = plain["seconds"]
        summary[f"memory_mb_n{size}"] = ours["memory_mb"]
        for peer in peers:
            row = by_key.get((peer, size))
            if row is None:
                continue
            summary[f"speedup_vs_{peer}_n{size}"] = row["seconds"] / ours["seconds"]
            summary[f"speedup_numpy_vs_{peer}_n{size}"] = row["seconds"] / plain["seconds"]
            summary[f"cpu_ratio_vs_{peer}_n{size}"] = row["cpu_seconds"] / ours["cpu_seconds"]
            summary[f"cpu_ratio_numpy_vs_{peer}_n{size}"] = row["cpu_seconds"] / plain["cpu_seconds"]
            if row["E"] is not None:
                summary[f"error_ratio_vs_{peer}_n{size}"] = ours["E"] / row["E"]
    extrapolated = [f"{row['implementation']} n={row['n']}" for row in rows if row["extrapolated"]]
    summary["extrapolated"] = ", ".join(extrapolated) or "none"
    return summary


def _clouds(size: int, seed: int) -> Clouds:
    """Samples of our own drill and, independently, of a smoothly warped copy."""
    mesh = canonical("drill").mesh()
    rng = np.random.default_rng([seed, size])
    source, target = (_surface(mesh, size, rng) for _ in range(2))
    radius = float(np.linalg.norm(source - source.mean(0), axis=1).max())
    waves = np.sin(2.5 * target[:, [1, 2, 0]] / radius + rng.uniform(0, 2 * np.pi, 3))
    target = target * rng.uniform(0.85, 1.2, 3) + 0.08 * radius * waves
    prepared = PreparedSource(source).normaliser
    return Clouds(prepared(source), prepared(target), prepared.scale)


def _surface(mesh, count: int, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """Points spread evenly over the surface."""
    triangles = np.asarray(mesh.triangles)
    areas = np.linalg.norm(np.cross(*np.diff(triangles, axis=1).transpose(1, 0, 2)), axis=1)
    chosen = triangles[rng.choice(len(areas), count, p=areas / areas.sum())]
    return np.einsum("nv,nvc->nc", rng.dirichlet(np.ones(3), count), chosen)
