"""Types of what callers give, for type checkers.

At run time they are `Any`: whatever is given is checked where it is used, and refused in a sentence that
names the argument.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from PIL.Image import Image

    from grasptransfer.camera import Camera
    from grasptransfer.grasping import Physics, Scene

    Picture = str | Path | Image | NDArray[np.uint8]
    Pictures = Picture | Sequence[Picture]
    Poses = ArrayLike | Sequence[ArrayLike] | None
    Cameras = Camera | str | Path | ArrayLike | Sequence[Camera | str | Path | ArrayLike | None] | None
    Box = Sequence[float] | NDArray[Any]
    Boxes = Box | Sequence[Box | None] | None
    Mask = NDArray[np.bool_] | Box | Callable[[NDArray[np.uint8]], NDArray[np.bool_] | Box]
    Masks = Mask | Sequence[Mask | None] | None
    Depths = NDArray[Any] | Sequence[NDArray[Any] | None] | None
    Sigmas = float | Sequence[float] | NDArray[Any] | Sequence[Any] | None
    Matrix = ArrayLike | None
    SomeScene = Scene | str | Path | None
    SomePhysics = Physics | Mapping[str, float] | None
else:
    Picture = Pictures = Poses = Cameras = Box = Boxes = Mask = Masks = Depths = Sigmas = Matrix = (
        SomeScene
    ) = Any
