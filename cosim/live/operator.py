"""What a person says to the controller: modes, commands, enables, emergency stop; one line of text each.

u 0.3 | u2 -0.1 | u3 0      manual commands, -1 to 1 (a bare number is u)
manual | auto                the mode of u
target 20 deg                where automatic goes
enable 1 | disable 1         of a command; off, it counts as 0
stop | reset                 emergency stop: every command 0, every enable off, until reset
quit
"""

import math
import os
import threading
from collections import deque
from pathlib import Path

from cosim.errors import DataError, UsageError
from cosim.signals import SIGNALS
from cosim.units import parse_quantity

WORDS = ("u", "u2", "u3", "manual", "auto", "target", "enable", "disable", "stop", "reset", "quit")


class Operator:
    """What is wanted now.

    Attributes:
        automatic: the mode of the first command.
        manual: the three manual commands, -1 to 1.
        enables: of the three commands.
        target: where automatic goes, deg; None stays where it is.
        stopped: emergency stop; every command is 0 and every enable off.
        ended: `quit` was said.
    """

    def __init__(self, automatic: bool = False, target: float | None = None) -> None:
        self.automatic, self.target = automatic, target
        self.manual, self.enables = [0.0, 0.0, 0.0], [True, False, False]
        self.stopped = self.ended = False

    def obey(self, line: str) -> None:
        """Does what a line says.

        Raises:
            UsageError: it cannot be read; nothing has changed then.
        """
        word, _, rest = line.strip().partition(" ")
        word, rest = word.lower(), rest.strip()
        if word in ("stop", "reset", "manual", "auto", "quit"):
            if rest:
                raise UsageError(f"'{line.strip()}': '{word}' stands alone")
            self._switch(word)
        elif word in ("enable", "disable"):
            if rest not in ("1", "2", "3"):
                raise UsageError(f"'{line.strip()}' should read {word} 1, 2 or 3")
            self.enables[int(rest) - 1] = word == "enable"
        elif word == "target":
            angle = parse_quantity(rest, "deg") if rest else math.nan
            low, high = (v / SIGNALS["slew"].to_si for v in (SIGNALS["slew"].low, SIGNALS["slew"].high))
            if not low <= angle <= high:
                raise UsageError(
                    f"'{line.strip()}' should read target ANGLE, from {low:g} to {high:g} deg, such as 20 deg"
                )
            self.target = angle
        else:
            self._move(word, rest, line)

    def _switch(self, word: str) -> None:
        if word == "stop":
            self.stopped = True
        elif word == "reset":
            # what was wanted before the stop is not wanted by a reset
            self.stopped, self.automatic, self.manual = False, False, [0.0, 0.0, 0.0]
        elif word == "quit":
            self.ended = True
        else:
            self.automatic = word == "auto"

    def _move(self, word: str, rest: str, line: str) -> None:
        place = {"u": 0, "u1": 0, "u2": 1, "u3": 2}.get(word)
        text = rest if place is not None else f"{word} {rest}".strip()
        try:
            value = float(text)
        except ValueError:
            raise UsageError(
                f"'{line.strip()}' cannot be read: a line is one of {', '.join(WORDS)}, or a command from -1 to 1"
            ) from None
        if not -1.0 <= value <= 1.0:
            raise UsageError(f"'{line.strip()}': a command lies within -1 to 1")
        self.manual[place or 0] = value


class Lines:
    """Lines from a file descriptor, read by a thread so that nobody waits for a person."""

    def __init__(self, descriptor: int = 0) -> None:
        self._lines: deque[str] = deque(maxlen=1000)
        self._descriptor = descriptor
        # the bare descriptor: a thread that waits inside sys.stdin would break the end of the process
        threading.Thread(target=self._read, name="operator", daemon=True).start()

    def take(self) -> str | None:
        """The next line, if one has come."""
        return self._lines.popleft() if self._lines else None

    def _read(self) -> None:
        kept = b""
        while True:
            try:
                part = os.read(self._descriptor, 4096)
            except OSError:
                return
            if not part:
                return
            *whole, kept = (kept + part).split(b"\n")
            kept = kept[:4096]
            self._lines.extend(text.decode("utf-8", "replace") for text in whole if text.strip())


def read_script(path: Path) -> list[tuple[float, str]]:
    """Lines to obey with their times [s]: ``2.5 auto``, in rising order; # starts a comment.

    Raises:
        DataError: the file cannot be read, or a line is bad; the message names it.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    found: list[tuple[float, str]] = []
    trial = Operator()
    for number, line in enumerate(lines, 1):
        stamp, _, words = line.partition("#")[0].strip().partition(" ")
        if not stamp:
            continue
        try:
            time = float(stamp)
            if not time >= (found[-1][0] if found else 0.0) or not math.isfinite(time):
                raise UsageError("times start at 0 and rise")
            trial.obey(words)
        except (ValueError, UsageError) as error:
            text = str(error) if isinstance(error, UsageError) else f"'{stamp}' is no time in s"
            raise DataError(f"{path}: row {number}: {text}") from None
        found.append((time, words))
    return found


def commands_of(
    excitation: str | None, file: Path | None, amplitude: float, seed: int, duration: float | None
) -> list[float]:
    """The manual command of each slot of a millisecond: of an excitation, or of a file; empty without either.

    Raises:
        UsageError: both are given, or the length of an excitation is missing or does not fit into memory.
    """
    if excitation is None and file is None:
        return []
    import numpy as np

    from cosim.rig.excitation import command, read_command

    if excitation is not None and file is not None:
        raise UsageError("--excitation and --input are two commands: give one")
    length = duration
    if file is not None:
        length = float(read_command(file)[0][-1])
    elif length is None:
        raise UsageError("an excitation has a length: give --duration")
    elif length > 36000.0:
        raise UsageError("an excitation of more than ten hours does not fit into memory: use --input")
    time = np.arange(round((length or 0.0) * 1000) + 1, dtype=np.float64) * 1e-3
    name = "file" if file is not None else excitation or ""
    found: list[float] = command(name, time, amplitude, seed, file).tolist()
    return found
