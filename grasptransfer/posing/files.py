"""`grasptransfer pose` and `grasptransfer board`: a picture in, a pose file out; a board to print."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float
from PIL import Image
from tyro.conf import Positional, arg

from grasptransfer.errors import SettingsError
from grasptransfer.files import replacing
from grasptransfer.options import CategoryName, Device, check_counts
from grasptransfer.perception.observation import read_image
from grasptransfer.perception.picture_camera import camera_of
from grasptransfer.perception.pose_search import PoseFinder
from grasptransfer.posing.board import Board, BoardFile
from grasptransfer.posing.session import PoseSession, describe

MOST_SHOWN = 4  # proposals side by side in an overview


@dataclass(frozen=True)
class PoseFileSettings:
    """A photograph in, a pose file out.

    Args:
        image: RGB picture.
        category: of the object in it.
        camera: camera file as of `transfer`; without it the photograph's EXIF data, else 60 degrees.
        box: u0 v0 u1 v1 around the object [px], as any detector gives it.
        out: pose file to write.
        browser: correct the pose in the browser; without, a proposal is written as it is.
        proposal: which one is written without browser, 1 the likeliest.
        overview: PNG of the proposals' outlines, to choose by.
        board: YAML of a marker board in the picture, on whose table the object stands.
        host: address to serve at; 0.0.0.0 lets other machines in.
        port: to serve at.

    Raises:
        SettingsError: a proposal below 1.
    """

    image: Positional[Annotated[Path, arg(metavar="PICTURE")]]
    category: CategoryName
    box: tuple[float, float, float, float]
    camera: Path | None = None
    out: Path = Path("pose.yaml")
    browser: bool = True
    proposal: int = 1
    overview: Path | None = None
    board: Path | None = None
    device: Device = "auto"
    host: str = "127.0.0.1"
    port: int = 8080

    def __post_init__(self):
        check_counts(self, "proposal")
        for key in ("out", "overview"):
            path = getattr(self, key)
            if path is not None and path.is_dir():
                raise SettingsError("is a folder", path=path, key=key, fix="Give a file")


def open_session(
    settings: PoseFileSettings, *, on_stage: Callable[[str], None] = lambda line: None
) -> PoseSession:
    """The proposals for a photograph, ready to be corrected.

    Args:
        on_stage: called with one line that says what is done next.

    Raises:
        GraspTransferError: wrong input, or nothing was found in the picture.
    """
    on_stage(f"reading {settings.image}")
    pixels = read_image(settings.image)
    camera = camera_of(settings.image, settings.camera, *pixels.shape[1::-1])
    table = None
    if settings.board is not None:
        table = Board.load(settings.board).find(pixels, camera)
    finder = PoseFinder(settings.category, device=settings.device)
    on_stage("searching the pose: some seconds")
    return PoseSession(finder, pixels, camera=camera, box=settings.box, camera_from_table=table)


def write_proposal(session: PoseSession, settings: PoseFileSettings) -> str:
    """Write a proposal without a browser; returns what to tell the user.

    Raises:
        SettingsError: there is no such proposal, or the file cannot be written.
    """
    session.choose(settings.proposal - 1)
    session.save(settings.out)
    lines = [f"{number}: {describe(one)}" for number, one in enumerate(session.proposals, 1)]
    return "\n".join([*lines, f"Written: {settings.out} (proposal {settings.proposal})"])


def write_overview(session: PoseSession, path: Path) -> None:
    """A picture of the first proposals side by side, in their order."""
    before = session.now
    pictures = []
    for number in range(min(MOST_SHOWN, len(session.proposals))):
        session.choose(number)
        pictures.append(session.overlay(longest=480))
    session.now = before
    joined: Float[np.ndarray, "h w 3"] = np.concatenate(pictures, axis=1)
    with replacing(path) as temporary:
        Image.fromarray(joined.astype(np.uint8)).save(temporary, format="PNG")


@dataclass(frozen=True)
class BoardSettings:
    """A ChArUco board in true size.

    Args:
        out: PDF or PNG file; a YAML file of its name describes the board.
        paper: a4, letter or a3.
        columns, rows: squares.
        square: side of a square [m].
    """

    out: Path = Path("board.pdf")
    paper: str = "a4"
    columns: int = 9
    rows: int = 6
    square: float = 0.03


def write_board(settings: BoardSettings) -> Path:
    """Write page and description of a board; returns the description's path.

    Raises:
        SettingsError: it does not fit the paper, or has more squares than there are markers.
    """
    from grasptransfer.yaml_models import parse

    data = {"columns": settings.columns, "rows": settings.rows, "square": settings.square,
            "marker": round(settings.square * 0.74, 5)}  # fmt: skip
    board = Board(parse(BoardFile, data, None, key="board", error=SettingsError))
    board.check()
    return board.write(settings.out, paper=settings.paper)
