"""Trained ensembles on disk: safetensors with what they were trained for, checked by checksum."""

import contextlib
import hashlib
import json
import shlex
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grasptransfer.category import Category, list_categories, objects_folder
from grasptransfer.category.category import CANONICAL, SHAPE_SPACE
from grasptransfer.errors import WeightsError
from grasptransfer.files import replacing
from grasptransfer.fitted import Fit, read_fits, write_fits
from grasptransfer.perception.confidence import PASS, POSE, VERDICTS, Confidence
from grasptransfer.perception.networks import build_network, network_names

if TYPE_CHECKING:
    from grasptransfer.perception.networks.ensemble import Ensemble

FORMAT_VERSION = 5
FITTED = (*VERDICTS, *PASS, *POSE, "overconfidence")  # of `Confidence`, by `grasptransfer train`
CHOSEN = ("latent_overconfidence", "accepted_score")
BLOCKS = {"confidence": FITTED, "chosen": CHOSEN}


@dataclass(frozen=True)
class WeightsInfo:
    """What a weight file says of itself.

    Args:
        network: name of its members for `build_network`.
        categories: `trained_on` of each category by its name, in the order of their numbers.
        confidence: fitted numbers that say how sure its estimates may be.
        width: width of its members for `build_network`.
    """

    network: str
    categories: dict[str, dict[str, str]]
    confidence: Confidence = field(default_factory=Confidence)
    width: float = 1.0


def save_weights(path: Path, ensemble: "Ensemble", info: WeightsInfo):
    """Write half-precision weights with their checksum in the header, and the confidence beside the file."""
    import torch
    from safetensors.torch import save_file

    tensors = {
        name: tensor.detach().to(torch.float16).contiguous() for name, tensor in ensemble.state_dict().items()
    }
    header = {
        "format_version": str(FORMAT_VERSION),
        "network": info.network,
        "width": repr(info.width),
        "members": str(len(ensemble.members)),
        "categories": json.dumps(info.categories),
        "sha256": _digest(tensors),
    }
    with replacing(path) as unfinished:
        save_file(tensors, unfinished, metadata=header)
    _write_confidence(path, header["sha256"], info.confidence, "not fitted: starting values")


def write_confidence(path: Path, confidence: Confidence) -> None:
    """Write what this process has fitted to a weight file: `path` with the ending `.yaml`.

    Raises:
        WeightsError: there are no such weights.
        SettingsError: it cannot be written.
    """
    with _opened(path) as file:
        sha256 = file.metadata()["sha256"]
    _write_confidence(path, sha256, confidence)


def _write_confidence(path: Path, sha256: str, confidence: Confidence, command: str | None = None) -> None:
    place, data = path.with_suffix(".yaml"), confidence.as_data()
    if place.is_file():
        chosen = read_fits(place, BLOCKS, error=WeightsError)["chosen"]
    else:
        chosen = Fit.today({name: data[name] for name in CHOSEN}, command="starting values")
    fitted = Fit.today({name: data[name] for name in FITTED}, command=command, fitted_to=sha256)
    write_fits(place, {"confidence": fitted, "chosen": chosen})


def _read_confidence(path: Path, header: dict[str, str]) -> Confidence:
    """Raises WeightsError: the file beside the weights is missing, or belongs to other weights."""
    place = path.with_suffix(".yaml")
    if not place.is_file() and "confidence" in header:  # weights written before there was such a file
        return Confidence.of_data(json.loads(header["confidence"]))
    fits = read_fits(place, BLOCKS, error=WeightsError)
    if fits["confidence"].fitted_to != header.get("sha256"):
        raise WeightsError(
            "was fitted to other weights",
            path=place,
            key="confidence.fitted_to",
            value=fits["confidence"].fitted_to,
            choices=[header.get("sha256")],
            fix="Get the file that belongs to them, or train again",
        )
    return Confidence.of_data(fits["confidence"].values | fits["chosen"].values)


@dataclass(frozen=True)
class StoredWeights:
    """What a weight file holds.

    Args:
        tensors: tensors in half precision, by their names in the ensemble.
        members: number of its members.
    """

    tensors: dict[str, np.ndarray]
    members: int
    info: WeightsInfo


def read_weights(path: Path) -> StoredWeights:
    """Read a weight file, and check it, without PyTorch.

    Raises:
        WeightsError: missing, unreadable, of another version, of an unknown network, or its checksum does not
            match.
    """
    if not path.is_file():
        raise WeightsError("trained weights are missing", path=path, fix="Train them: grasptransfer train")
    with _opened(path) as file:
        header = file.metadata()
        info = _info(header, path)
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    if _digest(tensors) != header.get("sha256"):
        raise WeightsError("is corrupt: the checksum does not match", path=path, fix="Get the file again")
    if info.network not in network_names():
        raise WeightsError("unknown network", path=path, value=info.network, choices=network_names())
    return StoredWeights(tensors, int(header["members"]), info)


def load_weights(path: Path) -> tuple["Ensemble", WeightsInfo]:
    """The ensemble with its weights, ready for evaluation, and what it was trained for.

    Raises:
        WeightsError: see `read_weights`.
    """
    stored = read_weights(path)
    return build_ensemble(stored), stored.info


def build_ensemble(stored: StoredWeights) -> "Ensemble":
    """PyTorch's ensemble with these weights, ready for evaluation."""
    import torch

    from grasptransfer.perception.networks.ensemble import Ensemble

    kind = (stored.info.network, len(stored.info.categories), stored.info.width)
    ensemble = Ensemble(build_network(*kind) for _ in range(stored.members))
    ensemble.load_state_dict({name: torch.from_numpy(t).float() for name, t in stored.tensors.items()})
    return ensemble.eval()


def trained_on(category: Category) -> dict[str, str]:
    """Checksums of what a network has learnt of a category: its model, and the space of its latent."""
    return {name: category.file.checksums.get(name, "") for name in (CANONICAL, SHAPE_SPACE)}


def check_trained_on(info: WeightsInfo, category: Category, path: Path) -> None:
    """Refuse weights that belong to another category, or to this one as it was before it was built again.

    Raises:
        WeightsError: they do; with the file of the category that differs.
    """
    found, wanted = info.categories.get(category.name, {}), trained_on(category)
    for name, what in ((CANONICAL, "canonical model"), (SHAPE_SPACE, "shape space")):
        if found.get(name) != wanted[name]:
            raise WeightsError(
                f"was trained on another {what}",
                path=path,
                key=f"{category.name}: {name}",
                value=found.get(name),
                fix=f"Train again: {_training(category)}",
            )


def find_weights(category: Category) -> Path:
    """The weight file that serves a category; of several the one that is for the fewest others, too.

    Raises:
        WeightsError: none does, with the categories that have one; none as the category is now; or several.
    """
    served = {path: info for path, info in _served().items() if category.name in info.categories}
    fitting = [
        path for path, info in served.items() if info.categories[category.name] == trained_on(category)
    ]
    fewest = min((len(served[path].categories) for path in fitting), default=0)
    fitting = [path for path in fitting if len(served[path].categories) == fewest]
    if len(fitting) == 1:
        return fitting[0]
    folder = objects_folder() / "models"
    if fitting:
        raise WeightsError(
            "several weight files serve this category",
            path=folder,
            key="category",
            value=category.name,
            choices=[path.name for path in fitting],
            fix="Move all but one elsewhere",
        )
    for path, info in served.items():
        check_trained_on(info, category, path)
    raise WeightsError(
        "no trained network for this category",
        path=folder,
        key="category",
        value=category.name,
        choices=trained_categories(),
        fix=f"Train one: {_training(category)}. Until then estimator 'cls' serves, with depth and a mask",
    )


def trained_categories() -> tuple[str, ...]:
    """Names of the shipped categories that have trained weights."""
    trained = {name for info in _served().values() for name in info.categories}
    return tuple(name for name in list_categories() if name in trained)


def _training(category: Category) -> str:
    """The command that trains a network for a category."""
    shipped = category.folder == objects_folder() / category.name
    return shlex.join(["grasptransfer", "train", category.name if shipped else str(category.folder)])


def _served() -> dict[Path, WeightsInfo]:
    """What each weight file says of itself."""
    served = {}
    for path in sorted((objects_folder() / "models").glob("*.safetensors")):
        with _opened(path) as file:
            served[path] = _info(file.metadata(), path)
    return served


@contextlib.contextmanager
def _opened(path: Path) -> Iterator:
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, "np") as file:
            yield file
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"is corrupt: {error}", path=path, fix="Get the file again") from error


def _info(header: dict[str, str] | None, path: Path) -> WeightsInfo:
    version = (header or {}).get("format_version")
    if header is None or version != str(FORMAT_VERSION):
        raise WeightsError(
            "unknown format", path=path, key="format_version", value=version, choices=[FORMAT_VERSION]
        )
    try:
        categories = json.loads(header["categories"])
        width = float(header.get("width", "1"))  # Weights written before there was a width have that of 1.
        return WeightsInfo(header["network"], categories, _read_confidence(path, header), width)
    except WeightsError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise WeightsError(f"is corrupt: {error!r}", path=path, fix="Get the file again") from error


def _digest(tensors) -> str:
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(name.encode())
        digest.update(np.asarray(tensors[name]).tobytes())
    return digest.hexdigest()
