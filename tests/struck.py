"""A command that gets a signal at the moment at which it says something: whoever reads along is told too late."""

import subprocess
import sys

CODE = """
import os, sys
from cosim.cli import main
number, at, *words = sys.argv[1:]
plain = sys.stderr.write
def write(text):
    written = plain(text)
    if at in text:
        sys.stderr.write = plain
        sys.stderr.flush()
        os.kill(os.getpid(), int(number))
    return written
sys.stderr.write = write
main(words)
"""


def struck(number: int, at: str, *words: object, **options: object) -> subprocess.CompletedProcess[str]:
    """Runs ``cosim WORDS``, which gets the signal as soon as it writes `at` to stderr."""
    command = [sys.executable, "-c", CODE, str(int(number)), at, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)  # type: ignore[call-overload,no-any-return]
