"""Build all FMUs and packages into build/: ``python build_fmus.py [--out FOLDER]``, the same as ``cosim build``."""

import sys

from cosim.cli import main

if __name__ == "__main__":
    main(["build", *sys.argv[1:]])
