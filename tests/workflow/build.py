"""Build a copy of the project beside the tests: `python build.py folder tasks...`.

First the smoke size, whole, twice; a copy of the second and what came of both are then written beside the folder. If
`full` is a task, the full size follows in the tree of the first build, in fewer readings (size `check`) and without
figures, which show no other code. `marsedl verify` builds and compares all of it.

Ends with 0 unless a build fails. Ends at once, with all that it started, when its standard input closes: it does not
outlive the tests that wait for it.
"""

import json
import os
import shutil
import signal
import sys
import threading
from pathlib import Path

from marsedl.replication.digests import digest_tree
from marsedl.replication.sizes import build_folder
from marsedl.replication.verification import PRODUCTS, build_twice, snakemake


def end_with_the_tests():
    os.read(0, 1)  # not through sys.stdin, whose lock Python wants when it ends
    os.killpg(0, signal.SIGKILL)


def build(folder: Path, tasks: list[str]) -> int:
    agree = build_twice(folder)
    folders = [folder / "build" / "verify" / str(number) for number in range(2)]
    builds = [build_folder(project, "smoke") for project in folders]
    built = {
        "agree": agree,
        "digests": [digest_tree(build, PRODUCTS) for build in builds],
        "logs": [sorted(str(path.relative_to(build)) for path in build.glob("logs/**/*.log")) for build in builds],
    }
    shutil.copytree(folders[1], folder.with_name("copy"))
    unfinished = folder.with_name("smoke.json.part")
    unfinished.write_text(json.dumps(built), encoding="utf-8")
    unfinished.rename(folder.with_name("smoke.json"))
    if "full" not in tasks:
        return 0
    process = snakemake(folders[0], "claims", "--cores", "2", "--config", "size=check")
    print(process.stdout)
    return process.returncode


if __name__ == "__main__":
    threading.Thread(target=end_with_the_tests, daemon=True).start()
    sys.exit(build(Path(sys.argv[1]), sys.argv[2:]))
