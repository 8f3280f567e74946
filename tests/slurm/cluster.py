"""A small Slurm of one's own on this machine, for the tests: `python cluster.py (up|down) folder`.

One controller, one node daemon and one munge daemon, which all live in the folder: configuration, key, sockets, state
and logs. There is no accounting, as on many small clusters, and no control groups: the node daemon follows the
processes of a job by itself, and kills a job that takes more memory than it asked for. Needs no privilege beyond that
of its user, who alone can use it. With `up`, prints the settings of the shell under which Slurm's commands find it.
"""

import argparse
import contextlib
import os
import pwd
import secrets
import shlex
import shutil
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "scancel", "squeue", "scontrol")
_FOLDERS = tuple(f"/{folder}sbin" for folder in ("usr/", "usr/local/", ""))  # which not every user's PATH holds
_CONFIGURATION = """\
ClusterName=marsedl
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SwitchType=switch/none
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=1
JobAcctGatherParams=OverMemoryKill
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SchedulerParameters=batch_sched_delay=0,sched_min_interval=10000,bf_interval=1
# A finished job stays in sight of squeue for longer than any run of the tests takes.
MinJobAge=86400
KillWait=3
SlurmdTimeout=20
ReturnToService=2
NodeName=node NodeHostname={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory={memory} State=UNKNOWN
PartitionName=tests Nodes=node Default=YES MaxTime=INFINITE State=UP
"""


def program(name: str) -> str | None:
    """Return the path of one of Slurm's or munge's programs; None if it is not installed."""
    return shutil.which(name) or shutil.which(name, path=os.pathsep.join(_FOLDERS))


def missing() -> list[str]:
    """Return the names of programs that a cluster needs and this machine does not have."""
    return [name for name in PROGRAMS if program(name) is None]


class Cluster:
    """A Slurm that lives in a folder.

    Args:
        folder: an absolute path, short enough for a socket (about 90 characters).
        cpus: the jobs of one core that may run at once.
        memory: of the node (MB), which jobs ask for; more than the machine has is no harm.

    """

    def __init__(self, folder: Path, cpus: int = 2, memory: int = 16000):
        self.folder, self.cpus, self.memory = folder.resolve(), cpus, memory
        self.configuration = self.folder / "slurm.conf"

    @property
    def environment(self) -> dict[str, str]:
        """Under which Slurm's commands speak to this cluster."""
        return {"SLURM_CONF": str(self.configuration), "PATH": f"{self.folder / 'bin'}{os.pathsep}{os.environ['PATH']}"}

    def up(self) -> None:
        """Start the three daemons and wait until a job could run; raises RuntimeError with what their logs say."""
        for name in ("state", "spool", "bin"):
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        # The executor plugin clears Slurm's variables for the steps of a job, SLURM_CONF as well.
        step = self.folder / "bin" / "srun"
        step.write_text(f'#!/bin/sh\nSLURM_CONF={self.configuration} exec {program("srun")} "$@"\n', encoding="utf-8")
        step.chmod(0o755)
        key = self.folder / "munge.key"
        key.touch(mode=0o600)
        key.write_bytes(secrets.token_bytes(128))
        self.configuration.write_text(
            _CONFIGURATION.format(
                host=socket.gethostname().split(".")[0],
                ports=_free_ports(2),
                user=pwd.getpwuid(os.getuid()).pw_name,
                folder=self.folder,
                cpus=self.cpus,
                memory=self.memory,
            ),
            encoding="utf-8",
        )
        files = {"key-file": "key", "socket": "socket", "pid-file": "pid", "log-file": "log", "seed-file": "seed"}
        options = [f"--{option}={self.folder}/munge.{end}" for option, end in files.items()]
        self._run("munged", "--force", *options)  # it mistrusts folders that others may not enter
        self._run("slurmctld", "-f", str(self.configuration))
        self._run("slurmd", "-f", str(self.configuration), "-N", "node")
        if not _wait(self._is_ready, 60):
            raise RuntimeError(f"the node does not get ready:\n{self._logs()}")

    def _is_ready(self) -> bool:
        return "State=IDLE" in self.command("scontrol", "--oneliner", "show", "node", "node").stdout

    def command(self, name: str, *arguments: str) -> subprocess.CompletedProcess:
        """Run one of Slurm's commands on this cluster; returns the finished process with its output."""
        return subprocess.run(
            [program(name), *arguments],
            env={**os.environ, **self.environment},
            capture_output=True,
            text=True,
            check=False,
        )

    def jobs(self, states: str = "all") -> dict[int, str]:
        """Return the states of the jobs that Slurm still knows of, by their number."""
        process = self.command("squeue", "--noheader", f"--states={states}", "--format=%i %T")
        return {int(number): state for number, state in (line.split() for line in process.stdout.splitlines())}

    def down(self) -> None:
        """End all jobs and daemons; the folder stays, with the logs."""
        self.command("scancel", f"--user={pwd.getpwuid(os.getuid()).pw_name}")
        _wait(lambda: not self.jobs("pending,running,completing"), 30)
        self.command("scontrol", "shutdown")
        _wait(lambda: not (self.folder / "slurmd.pid").exists(), 10)  # until then it needs munge
        self.command("munged", "--stop", f"--socket={self.folder}/munge.socket")

    def _run(self, name: str, *arguments: str) -> None:
        process = self.command(name, *arguments)
        if process.returncode:
            raise RuntimeError(f"{name} does not start:\n{process.stdout}{process.stderr}{self._logs()}")

    def _logs(self) -> str:
        parts = []
        for path in sorted(self.folder.glob("*.log")):
            parts.append(f"--- {path}\n{path.read_text(encoding='utf-8', errors='replace')[-2000:]}")
        return "\n".join(parts)


def _wait(until: Callable[[], bool], seconds: float) -> bool:
    """Wait until something is true, or that long; returns whether it is."""
    end = time.monotonic() + seconds
    while not (reached := until()) and time.monotonic() < end:
        time.sleep(0.2)
    return reached


def _free_ports(number: int) -> list[int]:
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(number)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]


def main() -> None:
    """Bring a cluster up or take it down."""
    parser = argparse.ArgumentParser(description="A small Slurm of one's own on this machine.")
    parser.add_argument("task", choices=("up", "down"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cpus", type=int, default=os.cpu_count())
    options = parser.parse_args()
    cluster = Cluster(options.folder, options.cpus)
    if options.task == "down":
        cluster.down()
        return
    if lacking := missing():
        parser.error(f"not installed: {', '.join(lacking)} (Debian: apt-get install slurm-wlm munge)")
    cluster.up()
    for name, value in cluster.environment.items():
        print(f"export {name}={shlex.quote(value)}")


if __name__ == "__main__":
    main()
