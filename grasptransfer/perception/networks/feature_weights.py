"""The weights of the picture features, as they lie in the package, compared with their checksum."""

import hashlib

import numpy as np

from grasptransfer.errors import WeightsError
from grasptransfer.perception.networks.architecture import FEATURES_FILE

FEATURES_SHA256 = "1b6b202b46f0297c12c4db223704e222c510f7fb381a9223eac7a7ae5af6917c"


def read_feature_weights() -> dict[str, np.ndarray]:
    """The tensors by their names, half precision.

    Raises:
        WeightsError: the file is missing, or is not the one that belongs to this version.
    """
    from safetensors.numpy import load

    try:
        content = FEATURES_FILE.read_bytes()
    except OSError as error:
        raise WeightsError("is missing", path=FEATURES_FILE, fix="Install grasptransfer again") from error
    if hashlib.sha256(content).hexdigest() != FEATURES_SHA256:
        raise WeightsError(
            "is corrupt: its checksum is another", path=FEATURES_FILE, fix="Install grasptransfer again"
        )
    return load(content)
