"""Marker boards to lay on a table: printed in true size, described by a YAML file, and found in pictures.

A ChArUco board is a chessboard whose white squares hold ArUco markers: these say which corner is which, also
where an object hides some, and corners of a chessboard are found to a fraction of a pixel (OpenCV's `aruco`
module). The frame of a board, `table`: origin at its middle, x to the right and y up as it is printed, z off
the paper.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float, UInt8
from PIL import Image
from pydantic import Field

from grasptransfer.camera import Camera
from grasptransfer.data_files import read_yaml
from grasptransfer.errors import ImageError, SettingsError
from grasptransfer.files import replacing, write_whole
from grasptransfer.frames import rigid
from grasptransfer.yaml_models import Strict, parse

DOTS = 300  # to an inch, of what is printed
INCH, MARGIN = 0.0254, 0.01  # m
PAPERS = {"a4": (0.297, 0.210), "letter": (0.2794, 0.2159), "a3": (0.420, 0.297)}  # m, lying on its side
FEWEST_CORNERS = 6
MOST_OFF = 2.0  # px: a board's corners that fit worse are those of another board, or of another camera


class BoardFile(Strict):
    """A board, as its YAML file says.

    Args:
        kind: of board.
        dictionary: of the markers, OpenCV's name.
        columns, rows: squares.
        square, marker: sides [m].
    """

    kind: str = Field(default="charuco", pattern="^charuco$")
    dictionary: str = "DICT_5X5_100"
    columns: int = Field(default=9, ge=3, le=30)
    rows: int = Field(default=6, ge=3, le=30)
    square: float = Field(default=0.03, gt=0, lt=1)
    marker: float = Field(default=0.022, gt=0, lt=1)


@dataclass(frozen=True)
class Board:
    """A board to print or to find.

    Args:
        file: what it is.
    """

    file: BoardFile

    @staticmethod
    def load(path: Path) -> "Board":
        """Of a board's YAML file.

        Raises:
            SettingsError: unreadable, or no board.
        """
        data = read_yaml(path, error=SettingsError)
        board = Board(parse(BoardFile, data, path, key="board", error=SettingsError))
        board.check(path)
        return board

    def check(self, path: Path | None = None) -> None:
        """
        Raises:
            SettingsError: markers that do not fit their squares, or too few for the board.
        """
        if self.file.marker >= self.file.square:
            raise SettingsError(
                "must be smaller than the square", path=path, key="marker", value=self.file.marker
            )
        aruco = _cv2().aruco
        if not hasattr(aruco, self.file.dictionary):
            choices = tuple(name for name in dir(aruco) if name.startswith("DICT_"))
            raise SettingsError(
                "is no dictionary of markers", path=path, key="dictionary", value=self.file.dictionary,
                choices=choices,
            )  # fmt: skip
        known = len(self._dictionary.bytesList)
        if self.file.columns * self.file.rows // 2 > known:
            raise SettingsError(
                f"has more squares than twice the dictionary's {known} markers", path=path, key="columns",
                value=f"{self.file.columns} x {self.file.rows}",
            )  # fmt: skip

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [m]."""
        return self.file.columns * self.file.square, self.file.rows * self.file.square

    def picture(self, *, dots_per_inch: float = DOTS) -> UInt8[np.ndarray, "h w"]:
        """The board alone, as it is printed."""
        width, height = (round(side / INCH * dots_per_inch) for side in self.size)
        return self._board.generateImage((width, height))

    def write(self, path: Path, *, paper: str = "a4") -> Path:
        """Write a page to print, PDF or PNG, and the board's YAML file beside it.

        Args:
            paper: one of `PAPERS`.

        Returns:
            the YAML file.

        Raises:
            SettingsError: another suffix or paper, or a board larger than the paper.
        """
        if path.suffix.lower() not in (".pdf", ".png"):
            raise SettingsError("must be a PDF or PNG file", path=path, key="out", choices=(".pdf", ".png"))
        if paper not in PAPERS:
            raise SettingsError("unknown paper", key="paper", value=paper, choices=tuple(PAPERS))
        free = [side - 2 * MARGIN for side in PAPERS[paper]]
        if self.size[0] > free[0] or self.size[1] > free[1]:
            value = f"{self.size[0]:.3f} x {self.size[1]:.3f} m"
            fix = "Take fewer or smaller squares, or larger paper"
            raise SettingsError(f"does not fit on {paper}", key="square", value=value, fix=fix)
        picture = self.picture()
        width, height = (round(side / INCH * DOTS) for side in PAPERS[paper])
        page = Image.new("L", (width, height), 255)
        page.paste(
            Image.fromarray(picture), ((width - picture.shape[1]) // 2, (height - picture.shape[0]) // 2)
        )
        with replacing(path) as temporary:
            page.save(temporary, format=path.suffix[1:].upper(), dpi=(DOTS, DOTS), resolution=DOTS)
        description = path.with_suffix(".yaml")
        text = "# Print at 100 %, then measure one square and correct `square` and `marker` here [m].\n"
        write_whole(description, (text + yaml.safe_dump(self.file.model_dump(), sort_keys=False)).encode())
        return description

    def find(self, image: UInt8[np.ndarray, "h w 3"], camera: Camera) -> Float[np.ndarray, "4 4"]:
        """`camera_from_table` [m] of the board in a picture.

        Raises:
            ImageError: too little of it is seen, or its corners do not fit this camera.
        """
        cv2 = _cv2()
        grey = np.ascontiguousarray(image[..., :3].mean(-1).round().astype(np.uint8))
        corners, numbers, _, _ = cv2.aruco.CharucoDetector(self._board).detectBoard(grey)
        count = 0 if numbers is None else len(numbers)
        if count < FEWEST_CORNERS:
            fix = f"{FEWEST_CORNERS} are needed: show more of it, larger and sharp, and check --board's file"
            raise ImageError("shows too few corners of the board", key="board", value=count, fix=fix)
        points, pixels = self._board.matchImagePoints(corners, numbers)
        points, pixels = points.reshape(-1, 3).astype(float), pixels.reshape(-1, 2).astype(float)
        found, turn, shift = cv2.solvePnP(points, pixels, camera.matrix, None, flags=cv2.SOLVEPNP_IPPE)
        if found:
            turn, shift = cv2.solvePnPRefineLM(points, pixels, camera.matrix, None, turn, shift)
        camera_from_print = rigid(cv2.Rodrigues(turn)[0], shift.ravel())
        off = camera.project(points @ camera_from_print[:3, :3].T + camera_from_print[:3, 3]) - pixels
        error = float(np.sqrt((off**2).sum(1).mean()))
        if not found or error > MOST_OFF:
            fix = "Are the camera's intrinsics right, and is this the board's file?"
            raise ImageError(
                "corners of the board lie where no board is", key="board", value=f"{error:.1f} px", fix=fix
            )
        return camera_from_print @ self._print_from_table

    @property
    def _print_from_table(self) -> Float[np.ndarray, "4 4"]:
        """OpenCV's axes of a board begin at its top left corner: x right, y down, z into the paper."""
        return rigid(np.diag([1.0, -1.0, -1.0]), np.array([self.size[0] / 2, self.size[1] / 2, 0.0]))

    @property
    def _dictionary(self) -> Any:
        aruco = _cv2().aruco
        return aruco.getPredefinedDictionary(getattr(aruco, self.file.dictionary))

    @property
    def _board(self) -> Any:
        shape = (self.file.columns, self.file.rows)
        return _cv2().aruco.CharucoBoard(shape, self.file.square, self.file.marker, self._dictionary)


def _cv2() -> Any:
    try:
        import cv2
    except ImportError as error:
        fix = "pip install 'grasptransfer[board]'"
        raise SettingsError("the package opencv-python-headless is missing", fix=fix) from error
    return cv2
