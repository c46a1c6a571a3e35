"""Beside other workers, none computes with more than one thread of OpenMP (torch): waiting at full speed for one another takes most of their time."""

import os

if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
