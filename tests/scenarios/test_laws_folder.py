"""Laws that were sent in fly: as they are written, and compiled, and lose no trial."""

from pathlib import Path

import numpy as np
import pytest

from marsedl.scenarios import arena, load
from marsedl.scenarios.own_law import own_law
from marsedl.scenarios.scenario import POOLS

ROOT = Path(__file__).parents[2]
LAWS = sorted(path for path in (ROOT / "laws").iterdir() if path.suffix in (".py", ".csv"))


@pytest.fixture(scope="module")
def scenario():
    return load("entry", ROOT)


@pytest.mark.parametrize("path", LAWS, ids=lambda path: path.stem)
def test_a_law_flies_as_it_is_written_and_compiled(path, scenario):
    law = own_law(path).design(scenario.onboard)
    assert scenario.campaign(law, "dispersed", 1).truth == ()
    compiled = arena.flown(scenario, law, "dispersed", POOLS["practice"], 0, 200)
    assert np.isfinite(compiled["miss"]).all(), np.unique(compiled.outcome, return_counts=True)
    written = arena.flown(scenario, law, "dispersed", POOLS["practice"], 0, 2, compiled=False)
    np.testing.assert_array_equal(written.values, compiled.values[:, :2])
