"""Syntax trees are made in threads: blocks are translated and compiled side by side."""

import ast
import gc
import inspect
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from fmus.syntax import parsed

TOP = Path(__file__).parents[2]


@pytest.fixture
def busy_collector() -> Iterator[None]:
    """Lets the threads take turns inside the making of a tree, as a collector with callbacks (hypothesis has one) does."""

    def give_way(phase: str, info: dict[str, int]) -> None:
        time.sleep(1e-6)

    threshold = gc.get_threshold()
    gc.callbacks.append(give_way)
    gc.set_threshold(50)
    yield
    gc.set_threshold(*threshold)
    gc.callbacks.remove(give_way)


def test_trees_made_in_threads_are_the_trees(busy_collector: None) -> None:
    source = inspect.getsource(inspect)[:20_000].rpartition("\ndef ")[0]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: parsed(source), range(16)))
    expected = ast.dump(ast.parse(source))
    assert [ast.dump(tree) for tree in found] == [expected] * 16


def test_text_that_is_not_python_is_refused() -> None:
    with pytest.raises(SyntaxError):
        parsed("def")


@pytest.mark.parametrize("folder", ["cosim", "fmus"])
def test_no_tree_is_made_without_the_lock(folder: str) -> None:
    unlocked = [
        file.relative_to(TOP).as_posix()
        for file in (TOP / folder).rglob("*.py")
        if "ast.parse(" in file.read_text(encoding="utf-8") and file.name != "syntax.py"
    ]
    assert unlocked == []
