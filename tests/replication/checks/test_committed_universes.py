"""What a build proves of the committed runs of universes, and what is said of tables in wrong places."""

import numpy as np
import pytest

from marsedl.replication.checks.universes import compare_universes
from marsedl.replication.errors import ArtifactError
from marsedl.replication.records import store
from marsedl.replication.universes.judging import COMMITTED
from marsedl.replication.universes.table import Universes, selected


def table():
    """Two universes of one choice, with one claim that holds."""
    whole, small, one, texts = np.zeros(2, np.int64), np.zeros(2, np.int8), np.ones(2), np.array(["", ""])
    along = {"design": small, "seed": whole, "wave": whole, "tries": whole, "sentence": texts}
    words = {"component": texts, "cause": np.array(["result"] * 2), "finding": np.array(["holds"] * 2)}
    rows = {"of": np.arange(2), "claim": np.array(["line"] * 2), "value": one, "error": one, "limit": one}
    given = {"assignment": one[:, np.newaxis], "choice": np.array(["slope"]), "trials": whole}
    return Universes(number=np.arange(2), **along, **words, **rows, **given)


def test_universes_that_are_not_compared_are_said_and_prove_nothing(tmp_path, capsys):
    """A paper without a committed run beside one that is compared, alone, and one whose run is of other code."""
    small, root = table(), tmp_path / "root"
    run, built = root / COMMITTED / "{}.h5", tmp_path / "report/universes/{}.h5"
    for name, world in (("toy", "a"), ("other", "b"), ("none", "")):
        store.save(str(built).format(name), small, paper=name, reading="universes", provenance={"world": "a"})
        if world:
            store.save(str(run).format(name), small, paper=name, reading="universes", provenance={"world": world})
    assert compare_universes(root, tmp_path, ["toy", "none"])
    assert "none: universes not compared: there is no committed run" in capsys.readouterr().out
    for papers in (["toy", "other"], ["other"], ["none"], []):
        assert not compare_universes(root, tmp_path, papers)
        said = "other: universes not compared: the committed run is of other inputs or code"
        assert (said in capsys.readouterr().out) == ("other" in papers)
    empty = selected(small, np.zeros(2, bool))
    store.save(str(built).format("toy"), empty, paper="toy", reading="universes", provenance={"world": "a"})
    assert not compare_universes(root, tmp_path, ["toy"])


@pytest.mark.parametrize("place", ["build", "committed"])
def test_the_table_that_is_another_papers_is_blamed_and_no_other(tmp_path, place):
    small, folders = table(), {"build": tmp_path / "report/universes", "committed": tmp_path}
    folders["committed"] = tmp_path / "root" / COMMITTED
    for of, folder in folders.items():
        paper = "other" if of == place else "toy"
        store.save(folder / "toy.h5", small, paper=paper, reading="universes", provenance={"world": paper})
    remedy = "run snakemake again" if place == "build" else f"git checkout {COMMITTED / 'toy.h5'}"
    said = rf"^{folders[place] / 'toy.h5'}: is of the paper 'other', not 'toy': .*{remedy}"
    with pytest.raises(ArtifactError, match=said):
        compare_universes(tmp_path / "root", tmp_path, ["toy"])
    path = folders[place] / "toy.h5"
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ArtifactError, match=rf"{path}: is truncated.*{remedy}"):
        compare_universes(tmp_path / "root", tmp_path, ["toy"])
