"""SLURM for tests: a real controller with one node, in a temporary directory, on free ports."""

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
from pathlib import Path

from tests.server.postgres import free_port
from tests.server.service_process import wait_until
from tests.tools import SLURM

TIMEOUT_S = 60.0
DAEMONS = ("munged", "slurmctld", "slurmd")
"""Programs in the order in which they start: keys of messages, controller, node."""
CONFIGURATION = """
ClusterName=foldback
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmdPort={node_port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={directory}/munge/socket
CredType=cred/munge
StateSaveLocation={directory}/state
SlurmdSpoolDir={directory}/spool
SlurmctldPidFile={directory}/slurmctld.pid
SlurmdPidFile={directory}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdParameters=config_overrides
SchedulerParameters=sched_min_interval=100000
KillWait=2
MessageTimeout=60
ReturnToService=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory={memory_mb} State=UNKNOWN
PartitionName=cpu Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""
"""Configuration of SLURM without systemd, control groups and accounting."""


class Slurm:
    """Cluster of one node; ``environment`` makes SLURM's commands talk to it.

    A job runs as the user of the tests, in ``jobs`` unless it says otherwise.

    Args:
        cpus: Number of jobs with one processor that run at once.
        memory_mb: Memory of the node that jobs may request, MB.
    """

    def __init__(self, cpus: int = 2, memory_mb: int = 16_000) -> None:
        SLURM.get()
        self.directory = Path(tempfile.mkdtemp(prefix="foldback-slurm-"))
        self.jobs = self.directory / "jobs"
        for name in ("state", "spool", "munge", "jobs"):
            (self.directory / name).mkdir(mode=0o700)
        self._key = self.directory / "munge" / "key"
        self._key.touch(mode=0o600)
        self._key.write_bytes(os.urandom(128))
        configuration = self.directory / "slurm.conf"
        configuration.write_text(
            CONFIGURATION.format(
                host=socket.gethostname().partition(".")[0],
                user=pwd.getpwuid(os.geteuid()).pw_name,
                directory=self.directory,
                controller_port=free_port(),
                node_port=free_port(),
                cpus=cpus,
                memory_mb=memory_mb,
            )
        )
        # Debian keeps the daemons where only root looks for programs.
        path = f"{os.environ['PATH']}{os.pathsep}/usr/sbin"
        self.environment = {**os.environ, "PATH": path, "SLURM_CONF": str(configuration)}
        self._processes: list[subprocess.Popen[bytes]] = []

    def start(self) -> "Slurm":
        """Start all daemons and wait until the node accepts jobs."""
        munge = self.directory / "munge"
        files = [f"--{name}-file={munge / name}" for name in ("key", "pid", "log", "seed")]
        # The directories above are open to others, which munged refuses otherwise.
        self._spawn("munged", "--foreground", "--force", f"--socket={munge / 'socket'}", *files)
        wait_until((munge / "socket").exists, self.log)
        self._spawn("slurmctld", "-D")
        self._spawn("slurmd", "-D")
        wait_until(
            lambda: self.run("sinfo", "--noheader", "--format=%T") == "idle",
            self.log,
            (subprocess.CalledProcessError,),
        )
        return self

    def run(self, *command: str) -> str:
        """Run a command of SLURM and return its output."""
        done = subprocess.run(
            command,
            env=self.environment,
            cwd=self.jobs,
            stdout=subprocess.PIPE,
            text=True,
            timeout=TIMEOUT_S,
            check=True,
        )
        return done.stdout.strip()

    def submit(self, script: str, *options: str) -> str:
        """Submit a command line as a job and return the number of the job."""
        return self.run("sbatch", "--parsable", *options, f"--wrap={script}")

    def running(self) -> list[str]:
        """Return the numbers of the jobs that run."""
        return self.run("squeue", "--noheader", "--states=R", "--format=%i").split()

    def log(self) -> str:
        """Return the ends of the logs of daemons and jobs."""
        files = sorted([*self.directory.glob("*.log"), *self.jobs.glob("*.out")])
        return "\n".join(f"{path.name}: {path.read_text()[-2000:]}" for path in files)

    def close(self) -> None:
        """End all jobs and daemons, and remove all files."""
        if len(self._processes) == len(DAEMONS):
            self.run("scancel", "--user", pwd.getpwuid(os.geteuid()).pw_name)
            wait_until(lambda: not self.run("squeue", "--noheader"), self.log)
        for process in reversed(self._processes):
            process.terminate()
            process.wait(TIMEOUT_S)
        shutil.rmtree(self.directory, ignore_errors=True)

    def _spawn(self, program: str, *arguments: str) -> None:
        with open(self.directory / f"{program}.log", "ab") as log:
            self._processes.append(
                subprocess.Popen(
                    [program, *arguments],
                    env=self.environment,
                    cwd=self.directory,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                )
            )
