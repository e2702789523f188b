"""FlowNet2 as the paper has it: eight channels in, three offset channels out.

    canonical, observed -> FlowNetC -> warp -> FlowNetS -> warp -> FlowNetS \\
                        -> FlowNetSD ---------------------------------------> fusion -> full resolution

A stack warps its second picture by the flow found so far, and offsets in space say nothing of flow. So
each stage estimates five channels, offsets and flow; the offsets are the paper's three. The last layer
also gives the scales and the mask that `Prediction` asks for; there are no heads for latent and match.

Sources: Ilg, Mayer, Saikia, Keuper, Dosovitskiy, Brox, FlowNet 2.0, 2017, sections 3-5 and supplement;
Rodriguez, Huber, Behnke 2020, section IV-C. The layers' widths are FlowNet2's: 162 million parameters.
Ours is trained end to end, theirs one network after the other; the paper's learning rate is 3e-5, and
the compact network's 1e-3 is too much for it.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional

from grasptransfer.perception.networks import CELL_PIXEL, FLOW_UNIT, STRIDE, Prediction
from grasptransfer.perception.zoom import MASK_STRIDE

OFFSETS, FLOW = 3, 2
MOTION = OFFSETS + FLOW
SCALES_AND_MASK = 3
PICTURE = 4  # channels of one picture: RGB or coordinates, and box or mask
STEM = (64, 128, 256)  # channels at strides 2, 4, 8
DEEP = (512, 512, 1024)  # at strides 16, 32, 64
UP = (512, 256, 128, 64)  # of the decoder, back to stride 4
REACH, STEP = 20, 2  # of the correlation, in cells of stride 8
REDIRECTED = 32
SLOPE = 0.1  # of the leaky ReLU


class FlowNet2(nn.Module):
    """The whole stack.

    Args:
        width: factor on the number of channels; 1 is FlowNet2, tests take less.
    """

    def __init__(self, width: float = 1.0):
        super().__init__()
        stacked = 3 * PICTURE + MOTION + 1  # both pictures, the warped one, motion, what the warp missed
        self.first = FlowNetC(width)
        self.second = FlowNetS(stacked, width)
        self.third = FlowNetS(stacked, width)
        self.small = FlowNetSD(width)
        self.fusion = Fusion(width)
        for layer in self.modules():
            if isinstance(layer, nn.Conv2d | nn.ConvTranspose2d):
                nn.init.kaiming_normal_(layer.weight, SLOPE)
                if layer.bias is not None:
                    nn.init.zeros_(layer.bias)
        nn.init.zeros_(self.fusion.answer.weight)

    def picture_features(self, pictures: Float[Tensor, "b 8 192 256"]) -> None:
        """None: this network has no part that others share."""

    def forward(
        self,
        pictures: Float[Tensor, "b 8 192 256"],
        category: Int[Tensor, "b"] | None = None,
        features: None = None,
    ) -> Prediction:
        """Predict from observed RGB + box and the model's coordinates + mask, stacked.

        Args:
            category: number of each sample's category; one network serves all alike.
            features: `picture_features`.
        """
        whole = self.full_resolution(pictures)
        cells = whole[:, :, CELL_PIXEL::STRIDE, CELL_PIXEL::STRIDE]
        offset, flow, scales, _ = cells.split([OFFSETS, FLOW, 2, 1], 1)
        mask = functional.avg_pool2d(whole[:, -1:], MASK_STRIDE)
        return Prediction(offset, scales[:, :1], flow, scales[:, 1:], mask)

    def full_resolution(self, pictures: Float[Tensor, "b 8 h w"]) -> Float[Tensor, "b 8 h w"]:
        """Offsets [OFFSET_UNIT], flow [FLOW_UNIT], their logarithmic scales, and the mask, per pixel."""
        observed, canonical = pictures.split(PICTURE, 1)
        motion = self.first(canonical, observed)
        for stage in (self.second, self.third):
            motion = stage(_stacked(canonical, observed, motion))
        return self.fusion(canonical, observed, motion, self.small(canonical, observed))


class FlowNetC(nn.Module):
    """Both pictures through one stem, compared by correlation: for large motion."""

    def __init__(self, width: float):
        super().__init__()
        self.stem = _stem(PICTURE, width)
        deepest = _scaled(STEM[-1], width)
        self.redirect = _conv(deepest, _scaled(REDIRECTED, width), 1, 1)
        correlated = (2 * REACH // STEP + 1) ** 2 + _scaled(REDIRECTED, width)
        self.joint = _conv(correlated, deepest, 3, 1)
        self.body = Hourglass(width)

    def forward(self, canonical: Tensor, observed: Tensor) -> Float[Tensor, "b 5 h w"]:
        """Motion at the pictures' resolution."""
        levels = _through(self.stem, canonical)
        other = _through(self.stem, observed)[-1]
        compared = functional.leaky_relu(correlation(levels[-1], other), SLOPE)
        joint = self.joint(torch.cat([self.redirect(levels[-1]), compared], 1))
        return _enlarged(self.body(joint, levels[1]), canonical)


class FlowNetS(nn.Module):
    """Everything stacked into one input: corrects the motion found so far."""

    def __init__(self, channels: int, width: float):
        super().__init__()
        self.stem = _stem(channels, width)
        self.joint = _conv(_scaled(STEM[-1], width), _scaled(STEM[-1], width), 3, 1)
        self.body = Hourglass(width)

    def forward(self, stacked: Tensor) -> Float[Tensor, "b 5 h w"]:
        """Motion at the input's resolution."""
        levels = _through(self.stem, stacked)
        return _enlarged(self.body(self.joint(levels[-1]), levels[1]), stacked)


class FlowNetSD(nn.Module):
    """Small kernels and a full-resolution first layer: for small motion."""

    def __init__(self, width: float):
        super().__init__()
        a, b, c = (_scaled(channels, width) for channels in STEM)
        self.start = _conv(2 * PICTURE, a, 3, 1)
        self.stem = nn.ModuleList(
            [
                nn.Sequential(_conv(a, a, 3, 2), _conv(a, b, 3, 1)),
                nn.Sequential(_conv(b, b, 3, 2), _conv(b, b, 3, 1)),
                nn.Sequential(_conv(b, c, 3, 2), _conv(c, c, 3, 1)),
            ]
        )
        self.body = Hourglass(width, smooth=True)

    def forward(self, canonical: Tensor, observed: Tensor) -> Float[Tensor, "b 5 h w"]:
        """Motion at the pictures' resolution."""
        levels = _through(self.stem, self.start(torch.cat([canonical, observed], 1)))
        return _enlarged(self.body(levels[-1], levels[1]), canonical)


class Hourglass(nn.Module):
    """From stride 8 down to 64 and back to 4; each level's motion is refined by the next finer one.

    Args:
        smooth: a convolution before each estimate but the coarsest.
    """

    def __init__(self, width: float, *, smooth: bool = False):
        super().__init__()
        shallow = [_scaled(channels, width) for channels in STEM]
        deep = [_scaled(channels, width) for channels in DEEP]
        up = [_scaled(channels, width) for channels in UP]
        entries = (shallow[-1], *deep[:-1])
        self.down = nn.ModuleList(
            nn.Sequential(_conv(a, b, 3, 2), _conv(b, b, 3, 1)) for a, b in zip(entries, deep, strict=True)
        )
        skips = (deep[1], deep[0], shallow[2], shallow[1])
        inputs = [deep[2], *(a + b + MOTION for a, b in zip(skips, up, strict=True))]
        self.widen = nn.ModuleList(_deconv(a, b) for a, b in zip(inputs[:-1], up, strict=True))
        self.smooth = nn.ModuleList(
            nn.Conv2d(a, b, 3, 1, 1) if smooth else nn.Identity() for a, b in zip(inputs[1:], up, strict=True)
        )
        features = [inputs[0], *(up if smooth else inputs[1:])]
        self.estimate = nn.ModuleList(nn.Conv2d(channels, MOTION, 3, 1, 1) for channels in features)

    def forward(self, joint: Tensor, fine: Tensor) -> Float[Tensor, "b 5 h4 w4"]:
        """Motion at stride 4.

        Args:
            joint: features of both pictures at stride 8.
            fine: features at stride 4.
        """
        levels = _through(self.down, joint)
        skips = (levels[1], levels[0], joint, fine)
        deep = levels[2]
        motion = self.estimate[0](deep)
        steps = zip(skips, self.widen, self.smooth, list(self.estimate)[1:], strict=True)
        for skip, widen, smooth, estimate in steps:
            deep = torch.cat([skip, widen(deep), _enlarged(motion, skip)], 1)
            motion = estimate(smooth(deep))
        return motion


class Fusion(nn.Module):
    """Chooses, pixel by pixel, between the motion of the stack and that of the small-motion network."""

    def __init__(self, width: float):
        super().__init__()
        a, b = _scaled(STEM[0], width), _scaled(STEM[1], width)
        up, last = _scaled(32, width), _scaled(16, width)
        self.start = _conv(PICTURE + 2 * (MOTION + 2), a, 3, 1)
        self.to_stride_2 = nn.Sequential(_conv(a, a, 3, 2), _conv(a, b, 3, 1))
        self.to_stride_4 = nn.Sequential(_conv(b, b, 3, 2), _conv(b, b, 3, 1))
        self.coarse = nn.Conv2d(b, MOTION, 3, 1, 1)
        self.to_half = _deconv(b, up)
        self.smooth_half = nn.Conv2d(b + up + MOTION, up, 3, 1, 1)
        self.middle = nn.Conv2d(up, MOTION, 3, 1, 1)
        self.to_whole = _deconv(b + up + MOTION, last)
        self.smooth_whole = nn.Conv2d(a + last + MOTION, last, 3, 1, 1)
        self.answer = nn.Conv2d(last, MOTION + SCALES_AND_MASK, 3, 1, 1)

    def forward(self, canonical, observed, large: Tensor, small: Tensor) -> Float[Tensor, "b 8 h w"]:
        """Motion, scales and mask at full resolution."""
        parts = [canonical]
        for motion in (large, small):
            missed = _missed(canonical, warp(observed, motion[:, OFFSETS:]))
            parts += [motion, motion.norm(dim=1, keepdim=True), missed]
        whole = self.start(torch.cat(parts, 1))
        half = self.to_stride_2(whole)
        quarter = self.to_stride_4(half)
        joined = torch.cat([half, self.to_half(quarter), _enlarged(self.coarse(quarter), half)], 1)
        motion = _enlarged(self.middle(self.smooth_half(joined)), whole)
        return self.answer(self.smooth_whole(torch.cat([whole, self.to_whole(joined), motion], 1)))


def correlation(
    first: Float[Tensor, "b c h w"], second: Float[Tensor, "b c h w"]
) -> Float[Tensor, "b d h w"]:
    """Mean product of each cell of `first` with the cells of `second` around it; 0 beyond the border."""
    batch, channels, height, width = first.shape
    products = first.flatten(2).transpose(1, 2) @ second.flatten(2) / channels
    products = functional.pad(products, (0, 1))  # what lies beyond the border is looked up here
    index = _neighbours(height, width).to(first.device).expand(batch, -1, -1)
    return products.gather(2, index).transpose(1, 2).unflatten(2, (height, width))


def warp(picture: Float[Tensor, "b c h w"], flow: Float[Tensor, "b 2 h w"]) -> Float[Tensor, "b c h w"]:
    """The picture seen at each pixel's end of the flow [FLOW_UNIT]; 0 outside."""
    height, width = picture.shape[2:]
    u = torch.arange(width, device=flow.device) + flow[:, 0].float() * FLOW_UNIT
    v = torch.arange(height, device=flow.device)[:, None] + flow[:, 1].float() * FLOW_UNIT
    grid = torch.stack([2 * u / (width - 1) - 1, 2 * v / (height - 1) - 1], -1)
    return functional.grid_sample(picture.float(), grid, align_corners=True).to(picture.dtype)


def _neighbours(height: int, width: int) -> Int[Tensor, "p d"]:
    """For each cell the numbers of the cells around it; height * width stands for none."""
    shifts = torch.arange(-REACH, REACH + 1, STEP)
    v = torch.arange(height)[:, None, None, None] + shifts[:, None]
    u = torch.arange(width)[:, None, None] + shifts
    inside = (v >= 0) & (v < height) & (u >= 0) & (u < width)
    return torch.where(inside, v * width + u, height * width).reshape(height * width, -1)


def _stacked(canonical: Tensor, observed: Tensor, motion: Tensor) -> Tensor:
    warped = warp(observed, motion[:, OFFSETS:])
    return torch.cat([canonical, observed, warped, motion, _missed(canonical, warped)], 1)


def _missed(canonical: Tensor, warped: Tensor) -> Tensor:
    """How different the pictures still are."""
    return (canonical - warped).norm(dim=1, keepdim=True)


def _stem(channels: int, width: float) -> nn.ModuleList:
    a, b, c = (_scaled(count, width) for count in STEM)
    return nn.ModuleList([_conv(channels, a, 7, 2), _conv(a, b, 5, 2), _conv(b, c, 5, 2)])


def _through(stages: nn.ModuleList, x: Tensor) -> list[Tensor]:
    """The output of every stage."""
    levels = []
    for stage in stages:
        x = stage(x)
        levels.append(x)
    return levels


def _enlarged(x: Tensor, like: Tensor) -> Tensor:
    return functional.interpolate(x, size=like.shape[2:], mode="bilinear", align_corners=False)


def _conv(a: int, b: int, kernel: int, stride: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(a, b, kernel, stride, (kernel - 1) // 2), nn.LeakyReLU(SLOPE))


def _deconv(a: int, b: int) -> nn.Sequential:
    return nn.Sequential(nn.ConvTranspose2d(a, b, 4, 2, 1), nn.LeakyReLU(SLOPE))


def _scaled(channels: int, width: float) -> int:
    return max(4, round(channels * width))
