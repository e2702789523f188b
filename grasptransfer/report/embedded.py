"""Pictures and films as data URIs, which a page carries inside itself."""

import base64
import io
from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8
from PIL import Image

Picture = UInt8[np.ndarray, "h w 3"]

JPEG_QUALITY = 88
GIF_COLOURS = 96


def jpeg_uri(picture: Picture) -> str:
    """The picture as a JPEG data URI."""
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "JPEG", quality=JPEG_QUALITY, optimize=True)
    return _uri("image/jpeg", buffer.getvalue())


def gif_uri(frames: Sequence[Picture], *, seconds_per_frame: float) -> str:
    """Frames as an endless GIF data URI."""
    return _uri("image/gif", gif_bytes(frames, seconds_per_frame=seconds_per_frame))


def gif_bytes(frames: Sequence[Picture], *, seconds_per_frame: float, hold_last: float = 1.2) -> bytes:
    """Frames as an endless GIF; the last one stays for a while."""
    pictures = [Image.fromarray(frame) for frame in frames]
    # One palette for all frames: otherwise plain grounds flicker.
    some = np.concatenate([frames[i] for i in np.linspace(0, len(frames) - 1, 4).round().astype(int)])
    palette = Image.fromarray(some).quantize(GIF_COLOURS)
    first, *rest = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    durations = [max(20, round(1000 * seconds_per_frame))] * len(pictures)
    durations[-1] += round(1000 * hold_last)
    buffer = io.BytesIO()
    first.save(buffer, "GIF", save_all=True, append_images=rest, duration=durations, loop=0, optimize=True)
    return buffer.getvalue()


def _uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
