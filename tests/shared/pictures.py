"""Pictures of the documentation: those that its pages make are those that they show."""

from contextlib import chdir, contextmanager
from pathlib import Path

import matplotlib as mpl
import numpy as np
from PIL import Image

IMAGES = Path(__file__).parents[2] / "docs" / "images"


@contextmanager
def drawn_as_shown(folder, *names):
    """Make pictures in a folder as a reader of the page does, without the style of figures that were drawn before.

    They have to be those of docs/images but for edges of letters and lines.
    """
    with chdir(folder), mpl.rc_context(mpl.rcParamsDefault):
        yield
    assert {path.stem for path in Path(folder).glob("*.png")} == {*names}
    for name in names:
        pictures = (Image.open(path / f"{name}.png").convert("L") for path in (Path(folder), IMAGES))
        made, kept = (np.asarray(picture, dtype=float) for picture in pictures)
        assert made.shape == kept.shape and np.abs(made - kept).mean() < 2.0, f"{name}: copy it to docs/images"
