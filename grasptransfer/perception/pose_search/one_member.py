"""One network of the ensemble by itself, on many views of one picture, whose features are made once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32

from grasptransfer.perception.networks import Prediction
from grasptransfer.perception.weights import build_ensemble, check_trained_on, find_weights, read_weights

if TYPE_CHECKING:
    from grasptransfer.category import Category

CHUNK = 8  # pictures to a pass: more do not fit the caches


class OneMember:
    """The first network of a category's ensemble, by PyTorch on the processor.

    Raises:
        WeightsError: the category has no trained network.
    """

    def __init__(self, category: Category):
        import torch

        from grasptransfer.perception.networks.ensemble import channels_last

        path = find_weights(category)
        stored = read_weights(path)
        check_trained_on(stored.info, category, path)
        self._number = list(stored.info.categories).index(category.name)
        self._network = channels_last(build_ensemble(stored).members[0], torch.device("cpu"))

    def __call__(
        self, pictures: Float32[np.ndarray, "b 8 192 256"], *, same_picture: bool = False
    ) -> Prediction:
        """What the network says of each input.

        Args:
            same_picture: all show the same picture, with other views of the model.
        """
        import torch

        parts, shared = [], None
        with torch.inference_mode():
            for start in range(0, len(pictures), CHUNK):
                inputs = torch.from_numpy(pictures[start : start + CHUNK])
                inputs = inputs.to(memory_format=torch.channels_last)
                if shared is None or not same_picture:
                    shared = self._network.picture_features(  # pyright: ignore[reportCallIssue]
                        inputs[:1] if same_picture else inputs
                    )
                features = shared
                if same_picture and shared is not None:
                    features = [level.expand(len(inputs), -1, -1, -1) for level in shared]
                number = torch.full((len(inputs),), self._number)
                parts.append(self._network(inputs, number, features))
        return Prediction(*(_joined(columns) for columns in zip(*parts, strict=True)))


def _joined(parts) -> Float32[np.ndarray, "b ..."] | None:
    """None where the network lacks a head."""
    if parts[0] is None:
        return None
    return np.concatenate([part.float().numpy() for part in parts])
