"""Runs a Python command whose processes can speak to nobody: the one that connects a socket is killed (SIGSYS), whichever language does it.

    python sealed.py ARGUMENTS      # as python ARGUMENTS

The kernel does it (seccomp), for this process and all that it starts; root is not needed. Linux on x86-64 or ARM64 only: elsewhere the command is
run as it is. Sockets of one machine are connected, too, to look a name up, say; pipes and pairs of sockets are not.
"""

import ctypes
import os
import platform
import struct
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

CONNECT = {"x86_64": (0xC000003E, 42), "aarch64": (0xC00000B7, 203)}
"""The audit number of an architecture, and that of its system call `connect`."""
PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, FILTER_MODE = 38, 22, 2
LOAD, EQUAL, RETURN = 0x20, 0x15, 0x06
ALLOW, KILL = 0x7FFF0000, 0x80000000
NUMBER, ARCHITECTURE = 0, 4
"""Where these lie in what the filter is given."""

KEPT = (
    "PATH",
    "PYTHONPATH",
    "LD_LIBRARY_PATH",
    "DYLD_LIBRARY_PATH",
    "OMP_NUM_THREADS",
    "OMP_WAIT_POLICY",
    "OPENBLAS_CORETYPE",
)
"""All that is left of the environment: telemetry is commonly off where `CI` and its like are set."""

SEALS = sys.platform == "linux" and platform.machine() in CONNECT


def seal() -> None:
    """From now on this process, and those that it starts, are killed where they connect a socket. Raises OSError."""
    architecture, connect = CONNECT[platform.machine()]
    steps = [
        (LOAD, 0, 0, ARCHITECTURE),
        (EQUAL, 0, 2, architecture),
        (LOAD, 0, 0, NUMBER),
        (EQUAL, 1, 0, connect),
        (RETURN, 0, 0, ALLOW),
        (RETURN, 0, 0, KILL),
    ]
    code = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *step) for step in steps))
    program = ctypes.create_string_buffer(struct.pack("@HP", len(steps), ctypes.addressof(code)))
    library = ctypes.CDLL(None, use_errno=True)
    if library.prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) or library.prctl(PR_SET_SECCOMP, FILTER_MODE, program):
        raise OSError(ctypes.get_errno(), "seccomp is refused")


def surroundings(home: Path) -> dict[str, str]:
    """The environment of somebody whose home this is."""
    return {key: os.environ[key] for key in KEPT if key in os.environ} | {"HOME": str(home), "LANG": "C.UTF-8"}


def sealed(arguments: Sequence[object], home: Path, folder: Path) -> "subprocess.CompletedProcess[str]":
    """`python ARGUMENTS` in a folder, as this file runs it, and in these surroundings."""
    command = [sys.executable, __file__, *map(str, arguments)]
    return subprocess.run(
        command, cwd=folder, env=surroundings(home), capture_output=True, text=True, timeout=600, check=False
    )


if __name__ == "__main__":
    if SEALS:
        seal()
    os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
