"""Small pieces of HTML: pictures as data URIs, figures, tables, marks."""

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources

import numpy as np
from jaxtyping import UInt8
from PIL import Image

Picture = UInt8[np.ndarray, "h w 3"]

JPEG_QUALITY = 88
GIF_COLOURS = 96


def style_sheet() -> str:
    """CSS of every page."""
    return resources.files("grasptransfer.report").joinpath("page.css").read_text(encoding="utf-8")


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


def figure(uri: str, caption: str, *, alt: str) -> str:
    """A picture with a caption; the caption is HTML, the alternative text is not."""
    return f'<figure><img src="{uri}" alt="{escape(alt)}"><figcaption>{caption}</figcaption></figure>'


def row(figures: Iterable[str], columns: str) -> str:
    """Figures side by side; `columns` is `two` or `three`."""
    return f'<div class="row {columns}">{"".join(figures)}</div>'


def section(title: str, lead: str, body: str) -> str:
    """A titled part of the page; lead and body are HTML."""
    return f'<section><h2>{escape(title)}</h2><p class="lead">{lead}</p>{body}</section>'


def pill(text: str, kind: str) -> str:
    """A coloured word; `kind` is `good`, `bad` or `neutral`."""
    return f'<span class="pill {kind}">{escape(text)}</span>'


def key(colour: tuple[int, int, int]) -> str:
    """A short line in the colour, for a legend."""
    return f'<span class="key" style="background: rgb{colour}"></span>'


def table(heads: Sequence[tuple[str, bool]], rows: Iterable[Sequence[str]]) -> str:
    """A table of HTML cells; each head says whether its column holds numbers."""
    kinds = [' class="number"' if numeric else "" for _, numeric in heads]
    top = "".join(f"<th{kind}>{escape(text)}</th>" for kind, (text, _) in zip(kinds, heads, strict=True))
    body = "".join(
        "<tr>" + "".join(f"<td{kind}>{cell}</td>" for kind, cell in zip(kinds, cells, strict=True)) + "</tr>"
        for cells in rows
    )
    return f'<div class="scroll"><table><tr>{top}</tr>{body}</table></div>'


def facts(pairs: Iterable[tuple[str, str]]) -> str:
    """A line of named values; the values are HTML."""
    return (
        '<dl class="facts">'
        + "".join(f"<div><dt>{escape(name)}</dt><dd>{value}</dd></div>" for name, value in pairs)
        + "</dl>"
    )


def matrix_text(matrix: np.ndarray) -> str:
    """A matrix as aligned text."""
    return "\n".join(" ".join(f"{value:9.5f}" for value in line) for line in matrix)
