"""The compact network as a graph of OpenVINO, built from the stored weights alone.

Half of the time of PyTorch's convolutions on a CPU, and no import of PyTorch. Layers follow `compact.py` and
`picture_features.py` line by line; `tests/test_answering.py` compares the answers.
"""

import threading
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float32
from openvino import CompiledModel, Core, Model
from openvino import opset13 as ops

from grasptransfer.perception.networks import LATENT_SIZE, Prediction
from grasptransfer.perception.networks.architecture import (
    GROUPS,
    STAGES,
    TAPPED,
)
from grasptransfer.perception.networks.feature_weights import read_feature_weights

EPSILON = 1e-5  # of PyTorch's group norm
SETTINGS = {
    "INFERENCE_PRECISION_HINT": "f32",
    "PERFORMANCE_HINT": "LATENCY",
    "NUM_STREAMS": 1,
    "ENABLE_CPU_PINNING": False,  # a thread that is bound to a core waits there for whatever else runs on it
}


class OpenvinoNetwork:
    """An ensemble of compact networks that answers for one category; usable from any thread.

    Args:
        tensors: tensors of the ensemble, by their names.
        members: number of its networks.
        number: number of the category.
        threads: number of threads to compute with.
    """

    def __init__(self, tensors: Mapping[str, np.ndarray], members: int, number: int, *, threads: int):
        model = _ensemble(_Layers(tensors), members, number)
        self._compiled: CompiledModel = Core().compile_model(
            model, "CPU", SETTINGS | {"INFERENCE_NUM_THREADS": threads}
        )
        self._local = threading.local()  # a request serves one thread at a time

    def __call__(self, pictures: Float32[np.ndarray, "1 8 192 256"]) -> Prediction:
        """Predict from observed RGB + box and the model's coordinates + mask, stacked."""
        if not hasattr(self._local, "request"):
            self._local.request = self._compiled.create_infer_request()
        found = self._local.request.infer([np.ascontiguousarray(pictures.transpose(0, 2, 3, 1))])
        motion, mask, latents, match = (found[output] for output in self._compiled.outputs)
        flow = motion[:, 4:6]
        means = (part.mean(axis=0, keepdims=True) for part in (
            motion[:, :3], motion[:, 3:4], flow, motion[:, 6:], mask, latents[:, :LATENT_SIZE],
            latents[:, LATENT_SIZE:], match[:, 0],
        ))  # fmt: skip
        spreads = np.sqrt(flow.var(axis=0).sum(axis=0)), (1 / (1 + np.exp(-mask[:, 0]))).std(axis=0)
        return Prediction(*means, *(spread[None] for spread in spreads))


def _ensemble(layers: "_Layers", members: int, number: int) -> Model:
    """From a channels-last picture to motion, mask, the category's latents and match of each member."""
    picture = ops.parameter([1, 192, 256, 8], np.float32)
    first = ops.transpose(picture, [0, 3, 1, 2])
    features = _picture_features(_Layers(read_feature_weights()), first)
    each = [_member(layers.of(f"members.{i}"), first, features, number) for i in range(members)]
    outputs = [ops.concat(list(parts), 0) for parts in zip(*each, strict=True)]
    return Model(outputs, [picture], "ensemble")  # pyright: ignore[reportGeneralTypeIssues]: its stub is wrong


def _picture_features(layers: "_Layers", pictures: Any) -> list[Any]:
    """Of the observed picture: what `PictureFeatures` computes."""
    rgb = ops.slice(pictures, [0], [3], [1], [1])
    x = ops.clamp(layers.convolution("stem", rgb, stride=2, padded_behind=True), 0.0, 6.0)
    tapped, width = [], x.get_output_shape(0)[1]
    for s, (_, stride, _, channels, blocks) in enumerate(STAGES):
        for b in range(blocks):
            block, step = layers.of(f"stages.{s}.{b}"), stride if b == 0 else 1
            y = ops.clamp(block.convolution("expand", x), 0.0, 6.0) if block.has("expand") else x
            y = block.convolution("filter", y, stride=step, padded_behind=step > 1, each_channel=True)
            y = block.convolution("project", ops.clamp(y, 0.0, 6.0))
            x = ops.add(x, y) if step == 1 and width == channels else y
            width = channels
        if s in TAPPED:
            tapped.append(x)
    return tapped


def _member(layers: "_Layers", pictures: Any, features: list[Any], number: int) -> tuple[Any, ...]:
    """What `CompactFlowNet.forward` computes: motion, mask, latents of one category, match."""
    told = [layers.normed(f"told.{i}", feature) for i, feature in enumerate(features)]
    levels = [ops.relu(ops.add(layers.normed("stem", pictures, stride=4), told[0]))]
    for i, more in enumerate(told[1:]):
        x = ops.relu(ops.add(layers.normed(f"down.{i}", levels[-1], stride=2), more))
        levels.append(layers.residual(f"refine.{i}.1", layers.residual(f"refine.{i}.0", x)))
    deep = levels[-1]
    context = ops.reshape(layers.convolution("context.0", deep), [1, -1], special_zero=False)
    context = ops.relu(layers.linear("context.2", context))
    spread = ops.reshape(layers.linear("spread", context), [1, -1, 1, 1], special_zero=False)
    deep = ops.add(deep, spread)
    for i, skip in enumerate(levels[-2:0:-1]):
        x = ops.relu(layers.normed(f"up.{i}.0", ops.concat([_double(deep), skip], 1)))
        deep = layers.residual(f"up.{i}.1", x)
    motion = layers.convolution("motion", deep)
    x = ops.relu(layers.normed("mask.0", ops.concat([_double(deep), levels[0]], 1)))
    mask = layers.convolution("mask.2", layers.residual("mask.1", x))
    shape = ops.relu(layers.linear("shape.0", context))
    chosen = slice(number * 2 * LATENT_SIZE, (number + 1) * 2 * LATENT_SIZE)
    return motion, mask, layers.linear("latent", shape, chosen), layers.linear("match", shape)


class _Layers:
    """Layers by the names of their weights.

    Args:
        tensors: all tensors, by their whole names.
        prefix: prefix of the names of these layers.
    """

    def __init__(self, tensors: Mapping[str, np.ndarray], prefix: str = ""):
        self._tensors, self._prefix = tensors, prefix

    def of(self, name: str) -> "_Layers":
        """The layers of a part of the network."""
        return _Layers(self._tensors, f"{self._prefix}{name}.")

    def has(self, name: str) -> bool:
        """Whether there is a layer of this name."""
        return f"{self._prefix}{name}.weight" in self._tensors

    def _weights(self, name: str) -> tuple[Float32[np.ndarray, "..."], Float32[np.ndarray, "_"] | None]:
        weight, bias = (self._tensors.get(f"{self._prefix}{name}.{part}") for part in ("weight", "bias"))
        assert weight is not None, f"{self._prefix}{name} has no weights"
        return weight.astype(np.float32), None if bias is None else bias.astype(np.float32)

    def convolution(
        self, name: str, x: Any, *, stride: int = 1, padded_behind: bool = False, each_channel: bool = False
    ) -> Any:
        """Convolution to the input's size over the stride.

        Args:
            padded_behind: pad as TensorFlow does, more behind; else as much on both sides.
            each_channel: every channel is filtered by itself.
        """
        weight, bias = self._weights(name)
        total = weight.shape[-1] - stride
        before, behind = total // 2, total - total // 2
        if not padded_behind:  # PyTorch's padding of half the kernel; an even one's as wide on both sides
            before = behind = (weight.shape[-1] - 1) // 2 if weight.shape[-1] % 2 else total // 2
        step = (stride, stride), (before, before), (behind, behind), (1, 1)
        if each_channel:
            y = ops.group_convolution(x, weight[:, None], *step)
        else:
            y = ops.convolution(x, weight, *step)
        return y if bias is None else ops.add(y, bias.reshape(1, -1, 1, 1))

    def normed(self, name: str, x: Any, *, stride: int = 1) -> Any:
        """Convolution and group norm: its parts 0 and 1."""
        return self.group_norm(f"{name}.1", self.convolution(f"{name}.0", x, stride=stride))

    def group_norm(self, name: str, x: Any) -> Any:
        """Mean 0 and variance 1 over each group of channels, then a scale and a shift of each channel."""
        weight, bias = self._weights(name)
        assert bias is not None
        # OpenVINO's own operation of this name ends the process on some CPUs (2026.4, AVX-512).
        grouped = ops.reshape(x, [1, GROUPS, -1], special_zero=False)
        grouped = ops.mvn(grouped, [2], True, EPSILON, "inside_sqrt")
        y = ops.reshape(grouped, list(x.get_output_shape(0)), special_zero=False)
        return ops.add(ops.multiply(y, weight.reshape(1, -1, 1, 1)), bias.reshape(1, -1, 1, 1))

    def residual(self, name: str, x: Any) -> Any:
        """Two convolutions beside an identity: `compact.ResidualBlock`."""
        body = self.of(f"{name}.body")
        y = body.convolution("1", ops.relu(body.normed("0", x)))
        return ops.relu(ops.add(x, body.group_norm("2", y)))

    def linear(self, name: str, x: Any, rows: slice = slice(None)) -> Any:
        """Matrix product and a shift, of the chosen rows."""
        weight, bias = self._weights(name)
        assert bias is not None
        return ops.add(ops.matmul(x, weight[rows], False, True), bias[rows][None])


def _double(x: Any) -> Any:
    """Twice the size, bilinear between pixel centres."""
    scales = np.array([2, 2], np.float32)
    return ops.interpolate(
        x, scales, "linear_onnx", "scales", [0, 0], [0, 0], "half_pixel", axes=np.array([2, 3])
    )
