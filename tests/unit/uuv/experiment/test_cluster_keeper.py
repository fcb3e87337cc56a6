"""Keeper of a cluster: what writes in its folder ends with the study, however that ends, and
nothing else does.
"""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from uuv.experiment.cluster_keeper import kept_cluster

LIMIT = 10.0  # [s]; measured below 1
HELD = """
import signal
import subprocess
import sys
import time
sys.path.insert(0, "scripts")
from uuv.experiment.cluster_keeper import kept_cluster
# A background shell starts what it runs with the signal ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
with kept_cluster() as folder:
    with open(f"{folder}/log", "w") as log:
        writer = subprocess.Popen(["sleep", "100"], stdout=log, start_new_session=True)
    print(writer.pid, folder, flush=True)
    time.sleep(100)
"""

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/fd").exists(), reason="looks for processes in /proc"
)


def ends(number: int) -> bool:
    """True if a process ends within the limit; a zombie has ended."""
    began = time.monotonic()
    while time.monotonic() - began < LIMIT:
        try:
            if Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except OSError:
            return True
        time.sleep(0.02)
    return False


def test_a_writer_ends_with_the_block_a_reader_goes_on():
    with kept_cluster() as folder:
        log = Path(str(folder), "log")
        with log.open("w") as log_file:  # this process writes too
            writer = subprocess.Popen(["sleep", "100"], stdout=log_file, start_new_session=True)
        log_reader = log.open("a")
        with log.open() as read:
            reader = subprocess.Popen(["sleep", "100"], stdin=read)
    assert writer.wait(LIMIT) == -signal.SIGKILL
    assert reader.poll() is None
    assert not log.parent.exists()
    log_reader.close()
    reader.kill()
    reader.wait()


@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_writer_ends_with_the_study(root, by):
    with subprocess.Popen(
        [sys.executable, "-c", HELD],
        cwd=root,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as study:
        assert study.stdout is not None
        number, folder = study.stdout.readline().split()
        assert Path(f"/proc/{number}").exists()
        os.kill(study.pid, by)
        study.wait(LIMIT)
    assert ends(int(number))
    assert Path(folder).exists()  # the logs tell what happened
    shutil.rmtree(folder)
