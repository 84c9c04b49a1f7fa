"""A command that stands still at its first write into a folder and goes on in a fork of itself, as often as it is asked.

``python benchmarks/first_write.py FOLDER WORD ...`` runs ``cosim WORD ...``. What is computed before the first file takes
its name is computed once; what follows can be ended at many moments (`benchmarks/kills.py`). Each line of stdin is a file
for what a fork says; the process answers with the fork's number, and with how it ended.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from cosim import files

READY = "ready"


def stand(asked: int, told: int) -> None:
    """Fork for each line that comes; returns in the forks alone."""
    os.write(told, f"{READY}\n".encode())
    with os.fdopen(asked) as lines:
        for line in lines:
            fork = os.fork()
            if fork == 0:
                said = os.open(line.strip(), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
                os.dup2(said, 1)
                os.dup2(said, 2)
                return
            os.write(told, f"{fork}\n".encode())
            _, status = os.waitpid(fork, 0)
            os.write(told, f"{os.waitstatus_to_exitcode(status)}\n".encode())
    os._exit(0)


def main() -> None:
    """Run the command up to its first write."""
    folder, words = Path(sys.argv[1]).resolve(), sys.argv[2:]
    asked, told = os.dup(0), os.dup(1)
    os.dup2(os.open(os.devnull, os.O_RDWR), 0)
    os.dup2(2, 1)
    whole, first = files.whole, [True]

    @contextmanager
    def waited(path: Path) -> Iterator[Path]:
        if first and path.resolve().is_relative_to(folder):
            first.clear()
            stand(asked, told)
        with whole(path) as part:
            yield part

    files.whole = waited  # before others take it by name
    from cosim.cli import main

    main(words)


if __name__ == "__main__":
    main()
