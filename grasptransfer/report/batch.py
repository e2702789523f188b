"""`grasptransfer transfer FOLDER`: every picture of a folder, one after the other; started again, it resumes.

Each picture has its own folder of files. `results.jsonl` has one line for each: what was found, or what was
wrong with it. A picture whose inputs and settings are those of its line is not done again.
"""

import json
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from rich.table import Table

import grasptransfer
from grasptransfer.errors import GraspTransferError, ImageError, SettingsError
from grasptransfer.files import content_key, write_whole
from grasptransfer.jobs.record import Record
from grasptransfer.picture_entries import ENDINGS
from grasptransfer.report.result_files import RESULT, check_folder
from grasptransfer.report.transfer_files import transfer_inputs
from grasptransfer.report.transfer_inputs import TransferInputs, TransferSettings, flow_of, read_inputs
from grasptransfer.transfer import GraspTransfer

RESULTS = "results.jsonl"
OF_EACH = ("pose", "camera", "mask", "depth")  # a file for all pictures, or a folder of files
OF_OBJECT = ("scene", "execute")  # the same


@dataclass(frozen=True)
class Batch:
    """What became of the pictures of a folder.

    Args:
        lines: one mapping for each picture: `image`, and what was found or `error`.
        again: pictures that were done before and taken from the record.
    """

    lines: tuple[dict, ...]
    again: int

    @property
    def usable(self) -> bool:
        """Whether every picture has a grasp to execute."""
        return all(line.get("usable", 0) > 0 for line in self.lines)

    @property
    def refused(self) -> tuple[str, ...]:
        """What is wrong with each picture that was refused, one sentence."""
        return tuple(f"{line['image']}: {line['error']}" for line in self.lines if "error" in line)

    def table(self) -> Table:
        """One row for each picture, and a last one for all."""
        table = Table("picture", "status", "usable", "best grasp", "expected success")
        for line in self.lines:
            if "error" in line:
                table.add_row(line["image"], "refused", "", "", "")
                continue
            best, score = line["best"], line["score"]
            usable = f"{line['usable']} of {line['grasps']}"
            table.add_row(
                line["image"], line["status"], usable, best or "-", "" if best is None else f"{score:.0%}"
            )
        counts = Counter("refused" if "error" in line else line["status"] for line in self.lines)
        with_grasp = sum(line.get("usable", 0) > 0 for line in self.lines)
        table.add_section()
        words = ", ".join(f"{count} {status}" for status, count in counts.most_common())
        table.add_row(f"{len(self.lines)} pictures", words, f"{with_grasp} with a grasp", "", "")
        return table


def run_batch(
    settings: TransferSettings,
    *,
    on_stage: Callable[[str], None] = lambda line: None,
    on_line: Callable[[dict], None] = lambda line: None,
) -> Batch:
    """Transfer grasps to the instance in every picture of the folder `settings.image`.

    Args:
        on_stage: called with one line that says what is done next.
        on_line: called with the line of each picture as soon as it is known.

    Raises:
        GraspTransferError: what is wrong with all of them, such as the category or the gripper.
    """
    check_folder(settings.out, "out")
    pictures = pictures_of(settings.image[0])
    on_stage(f"{len(pictures)} pictures; loading the category {settings.category}")
    flow = flow_of(settings)
    with Record(settings.out / RESULTS) as record:
        known = {line["key"]: line for line in record.lines() if "key" in line and "error" not in line}
        lines, again = [], 0
        for number, (picture, name) in enumerate(pictures, 1):
            on_stage(f"{number}/{len(pictures)} {picture.name}")
            line = {"image": picture.name}
            try:
                one = _of_picture(settings, picture, settings.out / name)
                given = read_inputs(one)
                key = _key(one, given, flow)
                if key in known and (one.out / RESULT).is_file():
                    line, again = known[key] | {"folder": str(one.out)}, again + 1
                else:
                    line = line | {"key": key} | _transferred(flow, given, one)
                    record.add(line)
            except GraspTransferError as error:
                line = line | {"error": str(error), "kind": type(error).__name__}
                record.add(line)
            lines.append(line)
            on_line(line)
    # One line for each picture, in their order, in place of those of all tries.
    write_whole(settings.out / RESULTS, "".join(json.dumps(line) + "\n" for line in lines).encode())
    return Batch(tuple(lines), again)


def pictures_of(folder: Path) -> list[tuple[Path, str]]:
    """The pictures in a folder by name, each with a name of its own for its results.

    Raises:
        ImageError: there are none.
    """
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDINGS and path.is_file())
    if not found:
        raise ImageError("holds no picture", path=folder, choices=ENDINGS)
    stems = Counter(path.stem for path in found)
    return [(path, path.stem if stems[path.stem] == 1 else path.name) for path in found]


def _of_picture(settings: TransferSettings, picture: Path, out: Path) -> TransferSettings:
    """The settings of one picture: files of its name in place of folders."""
    own: dict[str, Any] = {}
    for name in OF_EACH:
        own[name] = tuple(_file_of(given, picture, name) for given in getattr(settings, name))
    for name in OF_OBJECT:
        given = getattr(settings, name)
        own[name] = given and _file_of(given, picture, name)
    return replace(settings, image=(picture,), out=out, **own)


def _file_of(given: Path, picture: Path, key: str) -> Path:
    """The given file, or the one of the picture's name in the given folder."""
    if not given.is_dir():
        return given
    folder = given
    found = [path for path in sorted(folder.iterdir()) if path.stem == picture.stem and path != picture]
    if len(found) != 1:
        problem = f"holds {len(found) or 'no'} files of the picture's name"
        raise SettingsError(problem, path=folder, key=key, value=picture.stem)
    return found[0]


def _key(one: TransferSettings, given: TransferInputs, flow: GraspTransfer) -> str:
    """Names a result by all that it depends on."""
    plain = {
        field.name: getattr(one, field.name)
        for field in fields(one)
        if field.name not in ("image", "out", *OF_EACH, *OF_OBJECT)
    }
    files = {name: getattr(one, name) for name in ("mask", "depth", "scene", "execute")}
    category = flow.category.folder / "category.yaml"
    grasps = one.grasps or flow.category.grasps_path
    seen = [given.pictures[key] for key in ("image", "pose", "box", "pose_sigma")]
    camera = given.pictures["camera"].matrix
    hand = Path(one.gripper) if Path(one.gripper).is_file() else one.gripper
    # Its name, too: pictures may be equal, and each has a folder and a line of its own.
    name, version = one.image[0].name, grasptransfer.__version__
    return content_key(name, version, plain, files, category, grasps, hand, seen, camera)


def _transferred(flow: GraspTransfer, given: TransferInputs, one: TransferSettings) -> dict:
    start = time.perf_counter()
    outcome = transfer_inputs(flow, given, one)
    result = outcome.result
    best = result.usable[0] if result.usable else None
    return {
        "folder": str(one.out),
        "status": result.status.value,
        "advice": result.advice,
        "grasps": len(result.grasps),
        "usable": len(result.usable),
        "best": None if best is None else best.name,
        "score": None if best is None else round(float(best.score), 4),
        "camera_from_gripper": None if best is None else best.camera_from_gripper.tolist(),
        "held": [trial.grasp for trial in outcome.trials if trial.held] if one.execute else None,
        "seconds": round(time.perf_counter() - start, 3),
    }
