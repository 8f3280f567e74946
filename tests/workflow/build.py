"""Make the smoke build that the tests share: `python build.py folder`, which then holds it with what came of it.

The project is built twice as `marsedl verify` does. Both builds load the kernels that the tests compile, and compile
the others for them.
"""

import contextlib
import io
import json
import shutil
import sys
from pathlib import Path

from marsedl.replication.checks import twice
from marsedl.replication.checks.twice import copy_tree
from marsedl.replication.records.differences import digest_tree
from marsedl.replication.sizes import build_folder

ROOT = Path(__file__).parents[2]


def with_kernels(folder: Path) -> Path:
    """Let jobs in a copy of the project load the kernels that the tests compile; returns the folder."""
    (folder / ".cache").mkdir()
    for name in ("numba", "matplotlib"):
        (ROOT / ".cache" / name).mkdir(parents=True, exist_ok=True)
        (folder / ".cache" / name).symlink_to(ROOT / ".cache" / name)
    return folder


def main(folder: Path) -> None:
    """Build twice, and write what was said and the digests of the first."""
    project, said = copy_tree(ROOT, folder / "project"), io.StringIO()
    twice.copy_tree = lambda root, copy: with_kernels(copy_tree(root, copy))
    with contextlib.redirect_stdout(said):
        agree = twice.build_twice(project)
    print(said.getvalue())
    first, second = (project / "build" / "verify" / str(number) for number in range(2))
    digests = digest_tree(build_folder(first, "smoke"), twice.PRODUCTS)
    shutil.rmtree(second)
    result = {"agree": agree, "output": said.getvalue(), "digests": digests}
    (folder / "built.part").write_text(json.dumps(result), encoding="utf-8")
    (folder / "built.part").rename(folder / "built.json")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
