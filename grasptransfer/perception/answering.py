"""A trained network made ready to answer for one category: pictures in, predictions out, as numpy arrays.

PyTorch computes on a GPU and wherever OpenVINO is not installed; OpenVINO, the extra `fast`, takes half of
PyTorch's time on a CPU.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from jaxtyping import Float32

from grasptransfer.errors import SettingsError
from grasptransfer.jobs import cores
from grasptransfer.perception.device import answering_device
from grasptransfer.perception.networks import Prediction
from grasptransfer.perception.precision import answer_precision, arithmetic
from grasptransfer.perception.weights import WeightsInfo, build_ensemble, check_trained_on, read_weights

if TYPE_CHECKING:
    import torch

    from grasptransfer.category import Category

AnsweringNetwork: TypeAlias = Callable[[Float32[np.ndarray, "1 8 192 256"]], Prediction]


def load_answering(
    path: Path, category: Category, *, device: str = "auto", precision: str = "auto"
) -> tuple[AnsweringNetwork, WeightsInfo]:
    """The network of a weight file, which answers for the category from any thread.

    Args:
        device: see `device.DEVICES`.
        precision: see `precision.PRECISIONS`.

    Raises:
        WeightsError: see `read_weights`; or it was not trained on the category as it is.
        SettingsError: an unknown device or precision, or a network or precision that OpenVINO does not serve.
    """
    stored, precision = read_weights(path), answer_precision(precision)
    check_trained_on(stored.info, category, path)
    number = list(stored.info.categories).index(category.name)
    served = stored.info.network == "compact" and precision == "float32"
    chosen = answering_device(device, openvino_serves=served)
    if chosen != "openvino":
        import torch

        ensemble = build_ensemble(stored)
        return _TorchNetwork(ensemble, number, torch.device(chosen), precision), stored.info
    if not served:
        value = f"network {stored.info.network} in {precision}"
        raise SettingsError("serves the network compact in float32 only", key="device openvino", value=value)
    from grasptransfer.perception.networks.openvino_graph import OpenvinoNetwork

    return OpenvinoNetwork(stored.tensors, stored.members, number, threads=cores()), stored.info


class _TorchNetwork:
    """An ensemble on a device of PyTorch's."""

    def __init__(self, ensemble: torch.nn.Module, number: int, device: torch.device, precision: str):
        from grasptransfer.perception.networks.ensemble import channels_last

        self._ensemble, self._number = channels_last(ensemble, device), number
        self._device, self._precision = device, precision

    def __call__(self, pictures: Float32[np.ndarray, "1 8 192 256"]) -> Prediction:
        """Predict from observed RGB + box and the model's coordinates + mask, stacked."""
        import torch

        with torch.inference_mode(), arithmetic(self._device, self._precision):
            inputs = torch.from_numpy(pictures).to(self._device, memory_format=torch.channels_last)
            prediction = self._ensemble(inputs, torch.tensor([self._number], device=self._device))
        return Prediction(*(None if part is None else part.float().cpu().numpy() for part in prediction))
