"""Pictures of the documentation: those that its pages make are those that they show."""

from pathlib import Path

import numpy as np
from PIL import Image

IMAGES = Path(__file__).parents[2] / "docs" / "images"


def assert_shown(folder, *names):
    """Pictures that a page's commands left in a folder are those of docs/images but for edges of letters and lines."""
    assert {path.stem for path in folder.glob("*.png")} == {*names}
    for name in names:
        made, shown = (np.asarray(Image.open(path / f"{name}.png").convert("L"), float) for path in (folder, IMAGES))
        assert made.shape == shown.shape and np.abs(made - shown).mean() < 2.0, f"{name}: copy it to docs/images"
        assert (IMAGES / f"{name}.png").stat().st_size < 60_000
