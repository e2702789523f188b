"""The default network: a small U-shaped FlowNet with residual stages, made for two CPU cores.

It matches the observed picture with the model; what the picture shows by itself comes from `PictureFeatures`,
added at every level.

Group norm, not batch norm: the observed and the rendered picture have different statistics,
and batch statistics that mix them fail in evaluation.
"""

import itertools

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional

from grasptransfer.perception.networks import LATENT_SIZE, Prediction
from grasptransfer.perception.networks.architecture import CONTEXT, FEATURES, GROUPS, WIDTHS
from grasptransfer.perception.networks.picture_features import load_picture_features


class CompactFlowNet(nn.Module):
    """Encoder to stride 32 with a global context, decoder back to stride 8 (mask: 4).

    Args:
        categories: number of categories that it serves; each has its own last layer for the latent.
        width: factor on the number of channels; tests take less than 1.
    """

    def __init__(self, categories: int = 1, width: float = 1.0):
        super().__init__()
        widths, context = [_scaled(channels, width) for channels in WIDTHS], _scaled(CONTEXT, width)
        # In a tuple, the features are no part of the state: they never change and have a file of their own.
        self._picture_features = (load_picture_features(),)
        # One wide strided convolution: fine levels cost most of the time and hold least of the answer.
        self.stem = nn.Sequential(nn.Conv2d(8, widths[0], 8, 4, 2, bias=False), _norm(widths[0]))
        self.down = nn.ModuleList(
            nn.Sequential(nn.Conv2d(a, b, 3, 2, 1, bias=False), _norm(b))
            for a, b in itertools.pairwise(widths)
        )
        # Weight files know these layers as `told`: what the picture's features say.
        self.told = nn.ModuleList(
            nn.Sequential(nn.Conv2d(a, b, 1, bias=False), _norm(b))
            for a, b in zip(FEATURES, widths, strict=True)
        )
        self.refine = nn.ModuleList(nn.Sequential(ResidualBlock(b), ResidualBlock(b)) for b in widths[1:])
        # Where things are matters to the whole shape, so the deepest level is not pooled but flattened.
        self.context = nn.Sequential(
            nn.Conv2d(widths[-1], 24, 1),
            nn.Flatten(),
            nn.Linear(24 * 6 * 8, context),
            nn.ReLU(),
        )
        self.spread = nn.Linear(context, widths[-1])
        self.shape = nn.Sequential(nn.Linear(context, context), nn.ReLU())
        self.latent = nn.Linear(context, categories * 2 * LATENT_SIZE)
        self.match = nn.Linear(context, 1)
        self.up = nn.ModuleList(
            nn.Sequential(_conv(a + b, b, 1), ResidualBlock(b))
            for a, b in zip(widths[:1:-1], widths[-2:0:-1], strict=True)
        )
        self.motion = nn.Conv2d(widths[1], 7, 3, 1, 1)
        self.mask = nn.Sequential(
            _conv(widths[1] + widths[0], widths[0], 1),
            ResidualBlock(widths[0]),
            nn.Conv2d(widths[0], 1, 3, 1, 1),
        )
        for parameter in (*self.motion.parameters(), *self.latent.parameters()):
            nn.init.zeros_(parameter)

    def _apply(self, fn, recurse=True):
        # What moves or converts the network does the same to the features, which are no submodule.
        self._picture_features[0]._apply(fn)
        return super()._apply(fn, recurse)

    def picture_features(self, pictures: Float[Tensor, "b 8 192 256"]) -> list[Float[Tensor, "b _ _ _"]]:
        """Features of the observed picture alone; they are frozen and so the same for every such network."""
        return self._picture_features[0](pictures[:, :3])

    def forward(
        self,
        pictures: Float[Tensor, "b 8 192 256"],
        category: Int[Tensor, "b"],
        features: list[Float[Tensor, "b _ _ _"]] | None = None,
    ) -> Prediction:
        """Predict from observed RGB + box and the model's coordinates + mask, stacked.

        Args:
            category: number of each sample's category.
            features: `picture_features`, where they are known.
        """
        features = self.picture_features(pictures) if features is None else features
        shown = [layer(feature) for layer, feature in zip(self.told, features, strict=True)]
        levels = [torch.relu(self.stem(pictures) + shown[0])]
        for down, more, refine in zip(self.down, shown[1:], self.refine, strict=True):
            levels.append(refine(torch.relu(down(levels[-1]) + more)))
        deep = levels[-1]
        context = self.context(deep)
        deep = deep + self.spread(context)[:, :, None, None]
        for stage, skip in zip(self.up, levels[-2:0:-1], strict=True):
            deep = stage(torch.cat([_double(deep), skip], 1))
        motion = self.motion(deep)
        mask = self.mask(torch.cat([_double(deep), levels[0]], 1))
        offset, offset_log_scale, flow, flow_log_scale = motion.split([3, 1, 2, 1], 1)
        shape = self.shape(context)
        latents = self.latent(shape).view(len(shape), -1, 2, LATENT_SIZE)
        latent, latent_log_scale = latents[torch.arange(len(shape)), category].unbind(1)
        match = self.match(shape)[:, 0]
        return Prediction(
            offset, offset_log_scale, flow, flow_log_scale, mask, latent, latent_log_scale, match
        )


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions beside an identity."""

    def __init__(self, width: int):
        super().__init__()
        self.body = nn.Sequential(
            _conv(width, width, 1), nn.Conv2d(width, width, 3, 1, 1, bias=False), _norm(width)
        )

    def forward(self, x: Tensor) -> Tensor:
        """Refine features of any size."""
        return torch.relu(x + self.body(x))


def _conv(a: int, b: int, stride: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(a, b, 3, stride, 1, bias=False), _norm(b), nn.ReLU())


def _norm(width: int) -> nn.GroupNorm:
    return nn.GroupNorm(GROUPS, width)


def _scaled(channels: int, width: float) -> int:
    """A multiple of the groups near `channels * width`."""
    return GROUPS * max(1, round(channels * width / GROUPS))


def _double(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)
