"""Pictures of the report: figures with a palette of colours, at the width at which their letters can be read."""

import contextlib
import io
import json
from pathlib import Path
from typing import NamedTuple

from marsedl.replication.errors import ArtifactError

_PIXELS_PER_INCH = 80  # on a page: letters of 9 points are 10 pixels high
_RESOLUTION = 160  # pixels per inch of figures that do not say it


class Picture(NamedTuple):
    """A PNG and its size on a page, in pixels of the page."""

    content: bytes
    width: int
    height: int


def printed_places(path: Path) -> list[tuple[float, float]]:
    """Return each number that a figure marks as printed, with the span of its axis; none of a file that is no PNG."""
    from PIL import Image  # slow to import

    with contextlib.suppress(OSError, SyntaxError, ValueError), Image.open(path, formats=["PNG"]) as image:
        return [(value, span) for value, span in json.loads(image.info.get("printed", "[]"))]
    return []


def picture(path: Path) -> Picture:
    """Read a PNG with a palette of colours, which is a third of the size, or as it is where that is smaller.

    Raises ArtifactError if it is missing, damaged or no PNG.
    """
    from PIL import Image  # slow to import, and only needed here

    try:
        content, reduced = path.read_bytes(), io.BytesIO()
        with Image.open(io.BytesIO(content), formats=["PNG"]) as image:
            scale = _PIXELS_PER_INCH / image.info.get("dpi", (_RESOLUTION,))[0]
            size = [max(1, round(scale * pixels)) for pixels in image.size]
            if "A" not in image.getbands() or image.getchannel("A").getextrema() == (255, 255):
                # Maximum coverage keeps rare colours, as those of thin lines; one pass of k-means (the threshold ends
                # it) then moves each colour to the mean of its pixels.
                method, pixels = Image.Quantize.MAXCOVERAGE, image.width * image.height
                image = image.convert("RGB").quantize(256, method=method, kmeans=pixels, dither=Image.Dither.NONE)
            image.save(reduced, "PNG", compress_level=6)  # the best takes six times as long, for a tenth of the size
    except (OSError, SyntaxError, ValueError) as error:  # what Pillow raises for damaged files
        raise ArtifactError(f"{path}: figure cannot be read as PNG: {error}") from error
    return Picture(min(content, reduced.getvalue(), key=len), *size)
