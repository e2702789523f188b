"""`category.yaml`: what a category is, how it was built, and the checksums of its files."""

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, model_validator

from grasptransfer.data_files import read_yaml
from grasptransfer.errors import CategoryError
from grasptransfer.files import write_whole
from grasptransfer.yaml_models import parse

FILE_NAME = "category.yaml"
DENSITY = 500.0  # kg/m3, of a category that says none: that of the protocol `lift-shake-v1`
NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]*$"  # of a category: also a folder, and part of file names


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, populate_by_name=True)


class Frame(_Strict):
    """The frame that every file of the category is in."""

    length_unit: Literal["m"] = "m"
    up: Literal["+z"] = "+z"
    front: Literal["+x"] = "+x"
    origin: Literal["bounding box centre"] = "bounding box centre"


class Split(_Strict):
    """Names of the instances, `instances/<name>.glb` each.

    Args:
        canonical: which object the canonical model is; an instance's name, or a name of its own.
        train: instances behind the shape space.
        test: instances that nothing was fitted to.
    """

    canonical: str
    train: tuple[str, ...] = Field(min_length=1)
    test: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _distinct(self) -> "Split":
        names = [*self.train, *self.test]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"{twice[0]!r} is listed more than once in train and test")
        return self


class Settings(_Strict):
    """How the shape space was made.

    Args:
        beta: width of the kernel, in units of the control points' RMS radius.
        lam: smoothness of CPD, or of the fit through known correspondences; written `lambda`.
        modes: number of modes of the shape space.
        flexibility: standard deviation along each axis that the smooth modes add, which come last, in RMS
            radii; 0 where all are learnt.
        metric: scalar product in which its principal components are taken.
        correspondences: "cpd" (registered), or "exact" (known from a parametric model).
        outlier_weight: outlier weight of CPD, in [0, 1).
        control_points: number of control points.
        voxel: edge of the voxel filter of the control points [m].
        samples: shapes behind the shape space; more than the train instances for a parametric model.
    """

    beta: float = Field(gt=0)
    lam: float = Field(gt=0, validation_alias="lambda", serialization_alias="lambda")
    modes: int = Field(ge=1)
    flexibility: float = Field(default=0.0, ge=0)
    metric: Literal["W", "GW", "G"] = "GW"
    correspondences: Literal["cpd", "exact"]
    outlier_weight: float = Field(default=0.0, ge=0, lt=1)
    control_points: int = Field(ge=4)
    voxel: float = Field(gt=0)
    samples: int = Field(ge=1)


class CategoryFile(_Strict):
    """The contents of `category.yaml`.

    Args:
        density: of what an instance is made of, kg/m3 of the solid that its mesh encloses: its mass is this
            times the volume where nobody knows it better.
        measured: figures of the build, by name with their unit, such as `heldout_rms_mm`.
        checksums: sha256 of each file of the folder but this one and `grasps.yaml`, by relative path.
        versions: versions of the software that built it.
    """

    format: Literal["grasptransfer_category"] = "grasptransfer_category"
    format_version: Literal[1] = 1
    name: str = Field(pattern=NAME)
    description: str = ""
    frame: Frame = Frame()
    split: Split
    settings: Settings
    density: float = Field(default=DENSITY, ge=1, le=30_000)
    measured: dict[str, float | int | str | list[float]] = {}
    checksums: dict[str, str]
    versions: dict[str, str] = {}

    @staticmethod
    def load(folder: Path) -> "CategoryFile":
        """Read and validate the `category.yaml` of a folder.

        Raises:
            CategoryError: missing, not YAML, or with a wrong key or value.
        """
        path = folder / FILE_NAME
        if not path.exists():
            raise CategoryError("is missing", path=path, fix="Is this a category folder?")
        return parse(CategoryFile, read_yaml(path, error=CategoryError), path, error=CategoryError)

    def save(self, folder: Path) -> None:
        """Write `category.yaml`; write it last, since it vouches for the other files."""
        data = self.model_dump(mode="json", by_alias=True)
        text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=110)
        write_whole(folder / FILE_NAME, text.encode())


def software_versions() -> dict[str, str]:
    """Versions of what a category's bytes depend on."""
    names = ("grasptransfer", "numpy", "scipy", "trimesh")
    found = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    return found
