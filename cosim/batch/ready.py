"""What every worker needs, loaded once by the process from which they are forked: half a second of each worker's start."""

import contextlib

import cosim.batch.task
import cosim.ssp.read  # noqa: F401
from cosim.master import Runner, compiled  # noqa: F401

with contextlib.suppress(Exception):  # a worker that needs it meets the problem itself, and says so
    compiled.load()
