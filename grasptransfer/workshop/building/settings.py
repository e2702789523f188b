"""What a category is built from, and how."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import Positional, arg

from grasptransfer.category.settings import DENSITY, NAME
from grasptransfer.errors import CategoryError, SettingsError
from grasptransfer.options import Workers, check_counts
from grasptransfer.registration import Metric

# Narrower kernels and less smoothness fit the registered instances better, and unseen instances worse.
BETAS, LAMBDAS = (1.0, 2.0), (3.0, 10.0)


@dataclass(frozen=True)
class BuildSettings:
    """What a category is built from, and how its instances are registered and its shape space is learnt.

    Args:
        name: name of the category.
        meshes: folder of NAME.obj or NAME/mesh.obj (glb gltf obj ply stl off pcd xyz), also below train/ and
            test/.
        canonical: instance to take as the canonical model, a name or file; default: the best scored.
        test: instances to keep out of the shape space.
        out: folder to write; default: NAME here.
        front: axis of the files that is the front.
        up: axis of the files that points up.
        scale: metres in one unit of the files.
        beta: kernel width of CPD, in units of the canonical cloud's RMS radius; default: of several the one
            whose shape space leaves least of instances it never saw.
        lam: smoothness of CPD; default: chosen likewise.
        outlier_weight: outlier weight of CPD, in [0, 1).
        modes: number of modes of the shape space; default: the fewest with nearly the least error of such
            instances.
        flexibility: flexibility of smooth modes beside the learnt ones, for what few instances cannot show:
            standard deviation along each axis, in RMS radii; default: chosen likewise.
        metric: scalar product of the principal components: GW, G or W.
        control_points: approximate number of control points.
        description: description of the category, for people.
        density: what an instance is made of, kg/m3 of the solid that its mesh encloses.
        overwrite: replace an existing folder, keeping its grasps.

    Raises:
        CategoryError: a name that is no folder name.
        SettingsError: an option out of range.
    """

    name: Positional[Annotated[str, arg(metavar="NAME")]]
    meshes: Path
    canonical: str | None = None
    test: tuple[str, ...] = ()
    out: Path | None = None
    front: str = "+x"
    up: str = "+z"
    scale: float = 1.0
    beta: float | None = None
    lam: float | None = None
    outlier_weight: float = 0.0
    modes: int | None = None
    flexibility: float | None = None
    metric: Metric = "GW"
    control_points: int = 650
    description: str = ""
    density: float = DENSITY
    workers: Workers = 2
    overwrite: bool = False

    def __post_init__(self):
        if not re.match(NAME, self.name):
            raise CategoryError("must be letters, digits, _ and -", key="name", value=self.name)
        if self.canonical is not None:
            object.__setattr__(self, "canonical", Path(self.canonical).stem)
        check_counts(self, "workers")
        check_counts(self, "control_points", least=50)
        if self.modes is not None:
            check_counts(self, "modes")
        if not 1 <= self.density <= 30_000:
            raise SettingsError("must be from 1 to 30000 kg/m3", key="density", value=self.density)
        for key in ("scale", "beta", "lam"):
            value = getattr(self, key)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise SettingsError("must be above 0", key=key, value=value)
        if self.flexibility is not None and not 0 <= self.flexibility <= 1:
            raise SettingsError("must be between 0 and 1", key="flexibility", value=self.flexibility)

    @property
    def folder(self) -> Path:
        """Where the category is written."""
        return Path(self.name) if self.out is None else Path(self.out)

    @property
    def first_beta(self) -> float:
        """The given kernel width, or the first one that is tried."""
        return BETAS[0] if self.beta is None else self.beta

    @property
    def first_lam(self) -> float:
        """The given smoothness, or the first one that is tried."""
        return LAMBDAS[0] if self.lam is None else self.lam

    def kernels(self) -> list[tuple[float, float]]:
        """Every beta with every lambda that is to be tried."""
        betas = BETAS if self.beta is None else (self.beta,)
        return [(beta, lam) for beta in betas for lam in (LAMBDAS if self.lam is None else (self.lam,))]
