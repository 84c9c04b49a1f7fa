"""A package whose FMUs do nothing: what is left of a run is pythonfmu's wrapper and the master."""

import io
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

EMPTY = '''

    def install_running(self):
        """Answers as fast as a slave in Python can, every step another number: what stays is not set again."""
        super().install_running()
        answers = [[0.0] * count for count in range(self.n_outputs + 1)]
        wired = answers[1]

        def set_real(refs, new):
            pass

        def get_real(refs):
            return answers[len(refs)]

        def do_step(time, step):
            wired[0] = time
            return True

        self.set_real, self.get_real, self.do_step = set_real, get_real, do_step
'''


def emptied(package: Path, file: Path) -> Path:
    """Write a package like another one of ours, its FMUs' scripts such that setting, stepping and getting do nothing.

    Args:
        package: the .ssp to copy.
        file: where the copy goes.
    """
    with ZipFile(package) as source, ZipFile(file, "w", ZIP_DEFLATED) as copy:
        for name in source.namelist():
            content = source.read(name)
            copy.writestr(name, _emptied_fmu(content) if name.endswith(".fmu") else content)
    return file


def _emptied_fmu(content: bytes) -> bytes:
    packed = io.BytesIO()
    with ZipFile(io.BytesIO(content)) as source, ZipFile(packed, "w", ZIP_DEFLATED) as copy:
        main = source.read("resources/slavemodule.txt").decode().strip()
        for name in source.namelist():
            entry = source.read(name)
            if name == f"resources/{main}.py":
                # behind its slave's class the script only says what a second run of it finds
                script, end, rest = entry.partition(b"\n\n\nif locals() is not globals():")
                entry = script + EMPTY.encode() + end + rest
            copy.writestr(name, entry)
    return packed.getvalue()
