"""Pictures of one size in rows and columns, with text above and below them."""

import io
from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from grasptransfer.errors import SettingsError

LINE, GAP = 26, 6  # px: height of a line of text, space between pictures
INK = (40, 44, 52)
KINDS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}


def sheet(
    pictures: Sequence[UInt8[np.ndarray, "h w 3"]],
    columns: int,
    *,
    captions: Sequence[str] = (),
    heads: Sequence[str] = (),
    ground: tuple[int, int, int] = (255, 255, 255),
) -> UInt8[np.ndarray, "height width 3"]:
    """Pictures side by side.

    Args:
        pictures: the pictures, in the order of reading.
        columns: pictures in a row.
        captions: text below each picture; none given: no space for it.
        heads: text above each column; none given: no space for it.
        ground: colour between the pictures and behind the text.
    """
    height, width = pictures[0].shape[:2]
    top, below = LINE if heads else 0, LINE if captions else 0
    rows = -(-len(pictures) // columns)
    size = (columns * (width + GAP) - GAP, top + rows * (height + below + GAP) - GAP)
    page = Image.new("RGB", size, ground)
    pen, font = ImageDraw.Draw(page), ImageFont.load_default(15)
    for column, head in enumerate(heads):
        pen.text((column * (width + GAP) + 8, 3), head, INK, font)
    for index, picture in enumerate(pictures):
        left, upper = index % columns * (width + GAP), top + index // columns * (height + below + GAP)
        page.paste(Image.fromarray(picture), (left, upper))
        if captions:
            pen.text((left + 8, upper + height + 3), captions[index], INK, font)
    return np.asarray(page)


def encoded(picture: UInt8[np.ndarray, "h w 3"], suffix: str = ".png") -> bytes:
    """Content of a picture file with this suffix.

    Raises:
        SettingsError: the suffix names no kind of picture that is written.
    """
    if suffix.lower() not in KINDS:
        raise SettingsError("names no kind of picture", key="suffix", value=suffix, choices=KINDS)
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, KINDS[suffix.lower()], optimize=True)
    return buffer.getvalue()
