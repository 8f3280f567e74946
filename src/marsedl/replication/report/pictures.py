"""Pictures of the report: figures with a palette of colours, at the width at which their letters can be read."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from marsedl.replication.errors import ArtifactError

_COLOURS = 256  # all that a palette holds
_PIXELS_PER_INCH = 80  # on a page: letters of 9 points are 10 pixels high
_RESOLUTION = 160  # pixels per inch of figures that do not say it


@dataclass(frozen=True)
class Picture:
    """A PNG and its size on a page, in pixels of the page."""

    content: bytes
    width: int
    height: int


def picture(path: Path) -> Picture:
    """Read a figure as a picture for a page.

    Args:
        path: a PNG.

    Returns:
        The picture with a palette of colours, or the file as it is where that is smaller.

    Raises:
        ArtifactError: it is missing, damaged or no PNG.

    """
    from PIL import Image, UnidentifiedImageError  # slow to import, and only needed here

    try:
        content = Path(path).read_bytes()
        with Image.open(io.BytesIO(content), formats=["PNG"]) as image:
            smaller = _with_palette(image)
            scale = _PIXELS_PER_INCH / image.info.get("dpi", (_RESOLUTION,))[0]
            size = [max(1, round(scale * pixels)) for pixels in image.size]
    except UnidentifiedImageError as error:
        raise ArtifactError(f"{path}: not a PNG image") from error
    except (OSError, SyntaxError, ValueError) as error:  # what Pillow raises for damaged files
        raise ArtifactError(f"{path}: figure cannot be read: {getattr(error, 'strerror', None) or error}") from error
    return Picture(min(content, smaller, key=len), *size)


def _with_palette(image: Any) -> bytes:
    """The image as a PNG with a palette, which is a third of the size; transparent ones as they are.

    Maximum coverage keeps rare colours, as those of thin lines; one pass of k-means (the threshold ends it) then moves
    each colour to the mean of its pixels.
    """
    from PIL import Image

    if "A" in image.getbands() and image.getchannel("A").getextrema() != (255, 255):
        reduced = image
    else:
        reduced = image.convert("RGB").quantize(
            _COLOURS, method=Image.Quantize.MAXCOVERAGE, kmeans=image.width * image.height, dither=Image.Dither.NONE
        )
    content = io.BytesIO()
    reduced.save(content, "PNG", compress_level=6)  # the best takes six times as long, for a tenth of the size
    return content.getvalue()
