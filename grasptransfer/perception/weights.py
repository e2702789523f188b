"""Trained ensembles on disk: safetensors with what they were trained for, checked by checksum."""

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from grasptransfer.category import objects_folder
from grasptransfer.errors import WeightsError
from grasptransfer.files import replacing
from grasptransfer.perception.confidence import Confidence

if TYPE_CHECKING:
    from grasptransfer.perception.networks.ensemble import Ensemble

FORMAT_VERSION = 4


@dataclass(frozen=True)
class WeightsInfo:
    """What a weight file says of itself.

    Args:
        network: name of its members for `build_network`.
        categories: canonical checksum of each category it was trained on, in the order of their numbers.
        confidence: how sure its estimates may be.
    """

    network: str
    categories: dict[str, str]
    confidence: Confidence = field(default_factory=Confidence)


def save_weights(path: Path, ensemble: "Ensemble", info: WeightsInfo):
    """Write half-precision weights, with the checksum of the tensors in the header."""
    import torch
    from safetensors.torch import save_file

    tensors = {
        name: tensor.detach().to(torch.float16).contiguous() for name, tensor in ensemble.state_dict().items()
    }
    header = {
        "format_version": str(FORMAT_VERSION),
        "network": info.network,
        "members": str(len(ensemble.members)),
        "categories": json.dumps(info.categories),
        "confidence": json.dumps(info.confidence.as_data()),
        "sha256": _digest(tensors),
    }
    with replacing(path) as unfinished:
        save_file(tensors, unfinished, metadata=header)


def load_weights(path: Path) -> tuple["Ensemble", WeightsInfo]:
    """The ensemble (evaluation mode, float32) and its `WeightsInfo`.

    Raises:
        WeightsError: missing, unreadable, of another version, or its checksum does not match.
    """
    from safetensors import SafetensorError, safe_open

    from grasptransfer.perception.networks import build_network, network_names
    from grasptransfer.perception.networks.ensemble import Ensemble

    if not path.is_file():
        raise WeightsError("trained weights are missing", path=path, fix="Train them: grasptransfer train")
    try:
        with safe_open(path, "pt") as file:
            header = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"is corrupt: {error}", path=path, fix="Get the file again") from error
    if header.get("format_version") != str(FORMAT_VERSION):
        raise WeightsError(
            "unknown format",
            path=path,
            key="format_version",
            value=header.get("format_version"),
            choices=[FORMAT_VERSION],
        )
    if _digest(tensors) != header.get("sha256"):
        raise WeightsError("is corrupt: the checksum does not match", path=path, fix="Get the file again")
    if header["network"] not in network_names():
        raise WeightsError("unknown network", path=path, value=header["network"], choices=network_names())
    categories = json.loads(header["categories"])
    members = (build_network(header["network"], len(categories)) for _ in range(int(header["members"])))
    ensemble = Ensemble(members)
    ensemble.load_state_dict({name: tensor.float() for name, tensor in tensors.items()})
    confidence = Confidence.from_data(json.loads(header.get("confidence", "{}")))
    return ensemble.eval(), WeightsInfo(header["network"], categories, confidence)


def find_weights(category: str) -> Path:
    """The weight file that serves a category.

    Raises:
        WeightsError: none does; names the categories that have one.
    """
    served = _served()
    if category not in served:
        raise WeightsError(
            "no trained network for this category",
            path=objects_folder() / "models",
            key="category",
            value=category,
            choices=served,
            fix=f"Train one: grasptransfer train {category}",
        )
    return served[category]


def trained_categories() -> tuple[str, ...]:
    """Names of the categories that have trained weights."""
    return tuple(sorted(_served()))


def _served() -> dict[str, Path]:
    """Weight file of each category that has one."""
    from safetensors import SafetensorError, safe_open

    served = {}
    for path in sorted((objects_folder() / "models").glob("*.safetensors")):
        try:
            with safe_open(path, "pt") as file:
                names = json.loads((file.metadata() or {}).get("categories", "{}"))
        except (SafetensorError, OSError, json.JSONDecodeError) as error:
            raise WeightsError(f"is corrupt: {error}", path=path, fix="Get the file again") from error
        served |= dict.fromkeys(names, path)
    return served


def _digest(tensors) -> str:
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(name.encode())
        digest.update(tensors[name].numpy().tobytes())
    return digest.hexdigest()
