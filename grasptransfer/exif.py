"""What a photograph's EXIF data say about its camera."""

import numpy as np
from PIL import ExifTags, Image

FILM_DIAGONAL = float(np.hypot(36.0, 24.0))  # mm; CIPA DCG-001: 35 mm equivalents compare diagonals
MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0}  # in a unit of the sensor's resolution: inch, centimetre, millimetre


def focal_length(exif: Image.Exif, size: tuple[int, int]) -> tuple[float, str] | None:
    """Focal length [px] of a photograph that was not cropped, and by what; good to a few percent.

    Args:
        exif: EXIF data of the photograph.
        size: its width and height [px].

    Returns:
        None where the data do not say it.
    """
    tags, details = ExifTags.Base, exif.get_ifd(ExifTags.IFD.Exif)
    film = float(details.get(tags.FocalLengthIn35mmFilm) or 0)
    if film > 0:
        focal = film / FILM_DIAGONAL * float(np.hypot(*size))
        return focal, f"EXIF focal length, {film:g} mm in 35 mm equivalent, good to a few percent"
    unit = MILLIMETRES.get(details.get(tags.FocalPlaneResolutionUnit, 2), 0.0)
    focal = float(details.get(tags.FocalLength) or 0)
    density = float(details.get(tags.FocalPlaneXResolution) or 0)
    if min(unit, focal, density) <= 0:
        return None
    taken = float(details.get(tags.ExifImageWidth) or size[0])  # it may have been resized since
    pixels = focal * density / unit * size[0] / taken
    return pixels, f"EXIF focal length, {focal:g} mm, and the sensor's resolution, good to a few percent"
