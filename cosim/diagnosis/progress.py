"""The progress of a diagnosis on stderr: a bar on a terminal, a line a stage elsewhere."""

from collections.abc import Sequence
from types import TracebackType

from cosim.console import stderr_console, told
from cosim.diagnosis.watch import Watch

LAST = (("next", 3.0), ("report", 2.0))  # stages after the diagnosis itself, and their shares of the time


class ShownProgress(Watch):
    """Shows stages, candidates, the share that is done and the time left. A context manager."""

    def __init__(self) -> None:
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

        console = stderr_console()
        self._on_terminal = console.is_terminal
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TimeRemainingColumn(),
            TextColumn("left"),
            console=console,
            transient=True,
            disable=told("diagnosis", 0.0) or not self._on_terminal,
        )
        self._task = self._bar.add_task("diagnosis", total=None)
        self._shares: dict[str, float] = {}
        self._now, self._text, self._passes = "", "", 0

    def __enter__(self) -> "ShownProgress":
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Take the bar away."""
        self._bar.stop()

    def plan(self, stages: Sequence[tuple[str, float]]) -> None:
        """See `Watch.plan`."""
        self._shares = dict((*stages, *LAST))
        self._bar.update(self._task, total=sum(self._shares.values()))

    def stage(self, name: str, text: str) -> None:
        """See `Watch.stage`."""
        self._now, self._text, self._passes = name, text, 0
        if not told(text, self.done(0.0) / (sum(self._shares.values()) or 1.0)) and not self._on_terminal:
            stderr_console().print(f"diagnosis: {text}", markup=False, soft_wrap=True)
        self._bar.update(self._task, description=text, completed=self.done(0.0))

    def tried(self, done: int, total: int) -> None:
        """See `Watch.tried`. How many passes a stage needs is not known: each takes half of what is left of its share."""
        part = 1.0 - 0.5**self._passes * (1.0 - 0.5 * done / max(total, 1))
        text = (
            f"{self._text}, {done}/{total}"
            if self._passes == 0
            else f"{self._text}, pass {self._passes + 1}: {done}/{total}"
        )
        told(text, self.done(part) / (sum(self._shares.values()) or 1.0))
        self._bar.update(self._task, description=text, completed=self.done(part))
        self._passes += done == total

    def done(self, part: float) -> float:
        """What is done by now, `part` of the present stage included."""
        before = 0.0
        for name, share in self._shares.items():
            if name == self._now:
                return before + part * share
            before += share
        return 0.0
