"""Values that callers give, right and wrong: pictures, poses, cameras, masks, depth, scenes, settings."""

import typing
from pathlib import Path
from types import UnionType
from typing import Any

import numpy as np
import trimesh
from hypothesis import strategies as st
from PIL import Image
from scipy.spatial.transform import Rotation

from grasptransfer.camera import Camera

SIZE = (48, 64)  # small: what is tried is the arguments, not the picture
K = [[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]]
STANDING = [[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0.6], [0, 0, 0, 1]]
WORDS = ("", "mug", "teapot", "auto", "cpu", "panda", "../x", "\x00", "rgb", "lift-shake-v1", "+x")
PATHS = ("none", "", "/dev/null", "/proc/none/x", "x.json")

numbers = st.one_of(
    st.floats(-2, 2),
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([0.0, -0.0, 1e-320, 1e308, np.nan, np.inf, -np.inf, 1e-9, 1000.0]),
    st.integers(-5, 5),
)
odd = st.one_of(
    st.none(),
    st.text(max_size=3),
    st.booleans(),
    st.just(()),
    st.just({}),
    st.just(b"x"),
    numbers,
    st.just(object()),
)


def arrays(*shapes, dtypes=(np.float64,)):
    """Arrays of any of these shapes, with extreme numbers here and there."""

    @st.composite
    def drawn(draw):
        shape, dtype = draw(st.sampled_from(shapes)), draw(st.sampled_from(dtypes))
        rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
        values = rng.normal(size=shape) * draw(st.sampled_from([0.0, 1e-3, 0.3, 1.0, 1e3]))
        if values.size and draw(st.booleans()):
            values.flat[int(rng.integers(values.size))] = draw(numbers)
        with np.errstate(all="ignore"):
            array = values.astype(dtype)
        return draw(st.sampled_from([array, array.tolist()]))

    return drawn()


@st.composite
def poses(draw):
    """Rigid poses in front of the camera most of the time; else anything of the shape of a pose."""
    if draw(st.integers(0, 4)) == 0:
        return draw(st.one_of(odd, arrays((4, 4), (3, 4), (16,), (4,), (2, 4, 4), (0,))))
    turn = Rotation.random(rng=np.random.default_rng(draw(st.integers(0, 1000)))).as_matrix()
    pose = np.eye(4)
    pose[:3, :3] = turn * draw(st.sampled_from([1.0, 1.0, 1.0, 1.0 + 1e-9, 1.01, -1.0]))
    pose[:3, 3] = [draw(st.floats(-0.3, 0.3)), draw(st.floats(-0.3, 0.3)), draw(st.floats(0.02, 3.0))]
    if draw(st.integers(0, 5)) == 0:
        pose[draw(st.integers(0, 3)), draw(st.integers(0, 3))] = draw(numbers)
    return pose


@st.composite
def images(draw):
    kind = draw(st.integers(0, 5))
    if kind == 0:
        return draw(
            st.one_of(
                odd, arrays((*SIZE, 3), SIZE, (*SIZE, 4), (0, 0, 3), (1, 1, 3), dtypes=(np.uint8, float))
            )
        )
    pixels = np.random.default_rng(draw(st.integers(0, 99))).integers(0, 256, (*SIZE, 3)).astype(np.uint8)
    if kind == 1:
        pixels[:] = draw(st.integers(0, 255))
    return Image.fromarray(pixels) if kind == 2 else pixels


cameras = st.one_of(
    st.just(K),
    st.just(K),
    st.just(np.array(K)),
    st.just(Camera.from_matrix(np.array(K), *SIZE[::-1])),
    st.just(Camera.from_fov(32, 24, 1.0)),
    odd,
    arrays((3, 3), (3, 4), (4,)),
)
boxes = st.one_of(
    st.none(),
    st.just((20.0, 10.0, 44.0, 40.0)),
    st.tuples(numbers, numbers, numbers, numbers),
    odd,
    arrays((4,), (5,)),
)
masks = st.one_of(
    st.none(),
    boxes,
    st.just(np.ones(SIZE, bool)),
    st.just(np.zeros(SIZE, bool)),
    arrays(SIZE, (4,), SIZE[::-1], dtypes=(bool, float, np.uint8)),
    st.just(lambda picture: picture[..., 0] > 100),
    st.just(lambda picture: None),
    st.just(lambda picture: (1, 2, 3, 4)),
)
depths = st.one_of(
    st.none(),
    st.just(np.full(SIZE, 0.6)),
    arrays(SIZE, SIZE[::-1], (3,), dtypes=(float, np.float32, np.uint16)),
    odd,
)


@st.composite
def scenes(draw):
    """Scenes; what is wrong with one is said when it is made."""
    if draw(st.booleans()):
        return draw(st.one_of(st.none(), odd, st.just(Path("no_scene.yaml"))))
    extents = [draw(st.sampled_from([0.001, 0.1, 1.0])) for _ in range(3)]
    obstacles = tuple(
        (draw(st.sampled_from(["box", "wall", ""])), trimesh.creation.box(extents=extents), draw(poses()))
        for _ in range(draw(st.integers(0, 2)))
    )
    plane = draw(
        st.one_of(
            st.none(),
            st.just((np.array([0, 0.1, 0.6]), np.array([0, -1.0, 0]))),
            st.tuples(arrays((3,), (2,)), arrays((3,), (2,))),
        )
    )
    return obstacles, plane, draw(st.booleans())


sigmas = st.one_of(
    st.none(), st.just(0), st.just((0.01, 3.0)), st.tuples(numbers, numbers), odd, arrays((6, 6), (2,), ())
)
frames = st.one_of(st.none(), st.just(np.eye(4)), poses())
seeds = st.one_of(st.integers(0, 3), st.integers(-3, 2**70), odd)


# The arguments of each picture and of the whole call, and what is right for them.
OF_PICTURE = {
    "image": images(),
    "pose": poses(),
    "camera": cameras,
    "box": boxes,
    "mask": masks,
    "depth": depths,
    "pose_sigma": sigmas,
}
OF_ALL = {"scene": scenes(), "world_from_camera": frames, "seed": seeds}
RIGHT: dict[str, Any] = {
    "image": np.full((*SIZE, 3), 120, np.uint8),
    "pose": np.array(STANDING),
    "camera": K,
    "box": (20.0, 10.0, 44.0, 40.0),
    "mask": None,
    "depth": None,
    "pose_sigma": None,
}


def values_of(hint: Any) -> st.SearchStrategy:
    """Values that tyro makes of words for a field of this type, sensible and extreme."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        return values_of(inner[0])
    if origin in (typing.Union, UnionType):
        return st.one_of(*(values_of(one) for one in inner))
    if origin is tuple:
        if len(inner) == 2 and inner[1] is Ellipsis:
            one = values_of(inner[0])
            return st.just(()) if one.is_empty else st.lists(one, max_size=3).map(tuple)
        return st.tuples(*(values_of(one) for one in inner))
    if origin is typing.Literal:
        return st.sampled_from(inner)
    kinds = {
        type(None): st.none(),
        bool: st.booleans(),
        int: st.one_of(st.integers(-2, 5), st.sampled_from([-(2**63), 2**31, 2**70])),
        float: st.floats(allow_nan=True, allow_infinity=True) | st.sampled_from([0.0, 1.0, 0.5, -1.0]),
        str: st.sampled_from(
            ["", "mug", "teapot", "auto", "cpu", "panda", "../x", "\x00", "rgb", "lift-shake-v1", "+x"]
        ),
        Path: st.sampled_from(
            [Path("none"), Path(), Path("/dev/null"), Path("/proc/none/x"), Path("x.json")]
        ),
    }
    return kinds.get(hint, st.nothing())
