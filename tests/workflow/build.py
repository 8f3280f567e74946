"""Build a copy of the project beside the tests, at the lowest priority: `python build.py (smoke|full) folder`.

The smoke size is built whole, twice; the full size in fewer readings (size `check`) and without figures, which show no
other code. `marsedl verify` builds and compares all of it.

Ends with 0 if all is well, with 3 if the two smoke builds differ, with another number if a build fails. Ends at once,
with all that it started, when its standard input closes: it does not outlive the tests that wait for it.
"""

import os
import signal
import sys
import threading
from pathlib import Path

from marsedl.replication.verification import build_twice, snakemake


def end_with_the_tests():
    os.read(0, 1)  # not through sys.stdin, whose lock Python wants when it ends
    os.killpg(0, signal.SIGKILL)


def build(task: str, folder: Path) -> int:
    if task == "smoke":
        return 0 if build_twice(folder) else 3
    done = snakemake(folder, "claims", "--cores", "2", "--config", "size=check")
    print(done.stdout)
    return done.returncode


if __name__ == "__main__":
    threading.Thread(target=end_with_the_tests, daemon=True).start()
    os.nice(10)
    sys.exit(build(sys.argv[1], Path(sys.argv[2])))
