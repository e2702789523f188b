"""Sizes of the compact network and of its picture features, which PyTorch and OpenVINO build alike."""

from pathlib import Path

GROUPS = 8  # of every group norm
WIDTHS = (32, 64, 128, 208)  # channels of the compact network at strides 4, 8, 16, 32
CONTEXT = 320  # numbers that describe the picture as a whole

# EfficientNet-Lite0: kernel, stride, expansion, channels and blocks of each stage.
STAGES = (
    (3, 1, 1, 16, 1),
    (3, 2, 6, 24, 2),
    (5, 2, 6, 40, 2),
    (3, 2, 6, 80, 3),
    (5, 1, 6, 112, 3),
    (5, 2, 6, 192, 4),
    (3, 1, 6, 320, 1),
)
TAPPED = (1, 2, 4, 6)  # the last stage of each stride
FEATURES = tuple(STAGES[stage][3] for stage in TAPPED)  # channels at strides 4, 8, 16, 32
FEATURES_FILE = Path(__file__).with_name("efficientnet_lite0.safetensors")
