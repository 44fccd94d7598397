"""Names of runners: on which machine, in which process; and whether a runner of this machine still lives."""

import os
import socket
import uuid
from pathlib import Path

PROC = Path("/proc")
_left = set[str]()
"""Names that runners of this process have given up."""


def own_name() -> str:
    """Return a new name for a runner in this process: host, boot and process space, process id and start, a number."""
    return f"{_here()} {os.getpid()} {_started(os.getpid())} {uuid.uuid4().hex[:8]}"


def leave(name: str) -> None:
    """Give a name up: whatever is still claimed under it is nobody's."""
    _left.add(name)


def is_gone(name: str) -> bool:
    """Return whether a name was given up here, or its process ran on this machine and has ended.

    False where that is not told.
    """
    if name in _left:
        return True
    here, _, rest = name.partition(" ")
    if here != _here() or not _boot():
        return False
    pid, started, _ = rest.split(" ")
    return _started(int(pid)) != started


def _here() -> str:
    return f"{socket.gethostname()}/{_boot()}"


def _boot() -> str:
    """Return this boot's beginning and the space of process ids, as Linux tells them, else ''."""
    try:
        boot = (PROC / "sys/kernel/random/boot_id").read_text()[:8]
        return f"{boot}/{os.readlink(PROC / 'self/ns/pid').strip('pid:[]')}"
    except OSError:
        return ""


def _started(pid: int) -> str:
    """Return when a process began, in clock ticks since the boot; '' where there is none."""
    try:
        fields = (PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return "" if fields[0] in "ZX" else fields[19]  # a zombie has ended
