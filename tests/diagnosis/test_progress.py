"""Progress of a diagnosis: stages, candidates, the share that is done."""

import pytest

from cosim.diagnosis.progress import ShownProgress
from cosim.diagnosis.watch import Watch, counted, watched_by

PLAN = [("dcv", 10.0), ("mechanical", 16.0), ("extended", 6.0)]


class Kept(Watch):
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.seen: list[tuple[int, int]] = []

    def tried(self, done: int, total: int) -> None:
        self.seen.append((done, total))


def test_candidates_are_counted_where_somebody_watches() -> None:
    watch = Kept()
    assert list(counted("abc", 3)) == ["a", "b", "c"]
    with watched_by(watch):
        assert list(counted("abc", 3)) == ["a", "b", "c"]
    assert list(counted("ab", 2)) == ["a", "b"]
    assert watch.seen == [(1, 3), (2, 3), (3, 3)]


def test_the_share_done_only_grows_and_stays_within_the_stage() -> None:
    shown = ShownProgress()
    shown.plan(PLAN)
    total = shown._bar.tasks[0].total
    assert total is not None
    done = []
    for name, share in PLAN:
        shown.stage(name, name)
        begun = shown._bar.tasks[0].completed
        for _ in range(3):  # passes
            for k in range(1, 5):
                shown.tried(k, 4)
                done.append(shown._bar.tasks[0].completed)
        assert begun + 0.8 * share < done[-1] < begun + share
    assert done == sorted(done)
    assert done[-1] < total


def test_without_a_terminal_each_stage_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    from cosim import console

    console.stderr_console.cache_clear()  # it holds the stream of its first call
    try:
        with ShownProgress() as shown:
            shown.plan(PLAN)
            shown.stage("dcv", "dcv: 9 candidates")
            shown.tried(1, 9)
        said = capsys.readouterr()
    finally:
        console.stderr_console.cache_clear()
    assert said.err == "diagnosis: dcv: 9 candidates\n"
    assert said.out == ""
