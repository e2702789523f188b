"""The entry of one picture in a file of many.

Such files are a mapping of picture names to entries, a list of entries with `image`, BOP's `scene_gt.json`,
MegaPose's lists and `transforms.json`.
"""

from pathlib import Path
from typing import Any

from grasptransfer.errors import GraspTransferError

SHOWN = 5  # choices that a message shows of many pictures
NAME = "image"  # key of an entry that names its picture
ENDINGS = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")  # of pictures, lower case


def entry_of(
    data: Any, path: Path, image: str | Path | None, *, error: type[GraspTransferError]
) -> dict[str, Any]:
    """The mapping that belongs to one picture, and to the only object in it.

    Args:
        data: content of the file: one entry, a list of one, a list of entries with `image`, picture name ->
            entry, BOP's number of picture -> entry or list, or `transforms.json` with its `frames`, whose
            other keys hold for every picture.
        path: path of the file.
        image: the picture, whose name selects among several; None: the file must hold one picture only.
        error: the kind to raise.

    Raises:
        error: several pictures and none selected, several objects, or no mapping at all.
    """
    if isinstance(data, dict) and isinstance(data.get("frames"), list):
        shared = {key: value for key, value in data.items() if key != "frames"}
        data = shared | _frame_of(data["frames"], path, image, error)
    elif isinstance(data, dict) and data and all(key.isdecimal() for key in data):
        data = _numbered(data, path, image, error)
    elif isinstance(data, dict) and data and all(_is_picture(key) for key in data):
        data = _named(list(data.items()), path, image, error)
    elif isinstance(data, list) and data and all(isinstance(one, dict) and NAME in one for one in data):
        data = _named([(str(one[NAME]), one) for one in data], path, image, error)
    if isinstance(data, list) and data and all(isinstance(one, dict) for one in data):
        if len(data) != 1:
            labels = [one.get("obj_id", one.get("label")) for one in data]
            raise error(
                f"holds {len(data)} entries where one is wanted",
                path=path,
                value=labels,
                fix="Leave the entry of one object, in braces { }",
            )
        data = data[0]
    if not isinstance(data, dict):
        raise error("must hold a mapping of keys to values", path=path, value=data)
    return data


def _numbered(data: dict, path: Path, image: str | Path | None, error: type[GraspTransferError]) -> Any:
    """Of BOP's files: 000003.png belongs to the entry "3"."""
    if len(data) == 1:
        return next(iter(data.values()))
    numbers = {int(key): entry for key, entry in data.items()}
    stem = "" if image is None else Path(image).stem
    if stem.isdecimal() and int(stem) in numbers:
        return numbers[int(stem)]
    raise _several(path, image, [f"{number:06d}.png" for number in sorted(numbers)], error)


def _is_picture(name: object) -> bool:
    return str(name).lower().endswith(ENDINGS)


def _named(
    entries: list[tuple[str, Any]], path: Path, image: str | Path | None, error: type[GraspTransferError]
) -> Any:
    if len(entries) == 1 and image is None:
        return entries[0][1]
    wanted = None if image is None else Path(image).name
    of_it = [entry for name, entry in entries if Path(name).name == wanted]
    if len(of_it) == 1:
        return of_it[0]
    raise _several(path, image, [name for name, _ in entries], error)


def _frame_of(
    frames: list, path: Path, image: str | Path | None, error: type[GraspTransferError]
) -> dict[str, Any]:
    named = {Path(str(frame.get("file_path", ""))).stem: frame for frame in frames if isinstance(frame, dict)}
    if len(named) == 1:
        return next(iter(named.values()))
    stem = "" if image is None else Path(image).stem
    if stem in named:
        return named[stem]
    raise _several(path, image, list(named), error)


def _several(
    path: Path, image: str | Path | None, names: list[str], error: type[GraspTransferError]
) -> GraspTransferError:
    return error(
        f"holds {len(names)} pictures, and not one of them has the name of this one",
        path=path,
        key="image",
        value=None if image is None else Path(image).name,
        choices=[*names[:SHOWN], "..."] if len(names) > SHOWN else names,
    )
