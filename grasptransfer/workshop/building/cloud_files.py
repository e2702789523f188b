"""Reading point clouds: PCD (ascii, binary, binary_compressed) and XYZ."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from grasptransfer.errors import PointCloudError

_KINDS = {"F": "f", "I": "i", "U": "u"}


def read_pcd(path: Path) -> Float[np.ndarray, "m 3"]:
    """The x, y, z of a PCD 0.7 file, in the file's unit.

    Raises:
        PointCloudError: not such a file, cut short, or without x, y, z.
    """
    content = path.read_bytes()
    header, body = _header(content, path)
    try:
        dtype, total = _layout(header)
    except (KeyError, ValueError, TypeError) as cause:
        raise PointCloudError("has a broken PCD header", path=path, fix=f"{cause}") from cause
    names = dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise PointCloudError("has no x, y, z", path=path, key="FIELDS", value=" ".join(names))
    try:
        if header["DATA"] == "ascii":
            points = _table(body, dtype, total)
        elif header["DATA"] == "binary":
            points = _columns(np.frombuffer(body, dtype, total))
        elif header["DATA"] == "binary_compressed":
            points = _compressed(body, dtype, total)
        else:
            choices = ("ascii", "binary", "binary_compressed")
            raise PointCloudError("is unknown", path=path, key="DATA", value=header["DATA"], choices=choices)
    except (ValueError, IndexError, UnicodeDecodeError) as cause:
        if isinstance(cause, PointCloudError):
            raise
        raise PointCloudError("is cut short or broken", path=path, fix=f"{cause}") from cause
    if len(points) != total:
        raise PointCloudError(f"holds {len(points)} of {total} points", path=path)
    return points


def read_xyz(path: Path) -> Float[np.ndarray, "m 3"]:
    """The first three numbers of each line.

    Raises:
        PointCloudError: not such a file.
    """
    try:
        return np.loadtxt(path, ndmin=2, usecols=(0, 1, 2))
    except (ValueError, IndexError, UnicodeDecodeError) as cause:
        raise PointCloudError("is not a table of x, y, z", path=path, fix=f"{cause}") from cause


def _header(content: bytes, path: Path) -> tuple[dict[str, str], bytes]:
    header, start = {}, 0
    while "DATA" not in header:
        end = content.find(b"\n", start)
        if end < 0:
            raise PointCloudError("is not a PCD file", path=path)
        line = content[start:end].decode("ascii", errors="replace").strip()
        start = end + 1
        if line and not line.startswith("#"):
            key, _, value = line.partition(" ")
            header[key] = value.strip()
    return header, content[start:]


def _layout(header: dict[str, str]) -> tuple[np.dtype, int]:
    """What a point's fields are, and how many points there are."""
    names = header["FIELDS"].split()
    counts = [int(n) for n in header.get("COUNT", "1 " * len(names)).split()]
    kinds = [_KINDS[kind] for kind in header["TYPE"].split()]
    fields = zip(names, kinds, header["SIZE"].split(), counts, strict=True)
    layout = [
        (name, f"<{kind}{size}", *([(count,)] if count > 1 else [])) for name, kind, size, count in fields
    ]
    return np.dtype(layout), int(header["POINTS"])


def _table(body: bytes, dtype: np.dtype, total: int) -> Float[np.ndarray, "m 3"]:
    """A line for each point, a column for each number."""
    names = list(dtype.names or ())
    columns = np.cumsum([0, *(int(np.prod(dtype[name].shape)) for name in names)])
    rows = np.loadtxt(body.decode("ascii").splitlines(), ndmin=2)[:total]
    return np.stack([rows[:, columns[names.index(axis)]] for axis in "xyz"], -1)


def _columns(table: np.ndarray) -> Float[np.ndarray, "m 3"]:
    return np.stack([table[axis].astype(float) for axis in "xyz"], -1)


def _compressed(body: bytes, dtype: np.dtype, total: int) -> Float[np.ndarray, "m 3"]:
    """Two sizes, then LZF; the fields lie one after the other, not point by point."""
    packed, size = np.frombuffer(body, "<u4", 2)
    data = _lzf(body[8 : 8 + int(packed)], int(size))
    columns, start = {}, 0
    for name in dtype.names or ():
        width = dtype[name].itemsize * total
        if name in "xyz":
            columns[name] = np.frombuffer(data, dtype[name], total, start).astype(float)
        start += width
    return np.stack([columns[axis] for axis in "xyz"], -1)


def _lzf(packed: bytes, size: int) -> bytes:
    """Decompress Marc Lehmann's LZF: runs of literals, and copies of what was written before."""
    out, at = bytearray(), 0
    while at < len(packed):
        control = packed[at]
        at += 1
        if control < 32:
            out += packed[at : at + control + 1]
            at += control + 1
            continue
        length, back = (control >> 5) + 2, (control & 31) << 8
        if length == 9:
            length += packed[at]
            at += 1
        back += packed[at] + 1
        at += 1
        if back > len(out):
            raise ValueError("a copy reaches before the beginning")
        for _ in range(length):  # The copy may overlap its own output.
            out.append(out[-back])
    if len(out) != size:
        raise ValueError(f"{len(out)} of {size} bytes")
    return bytes(out)
