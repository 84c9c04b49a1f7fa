"""Python text into its syntax tree, from any thread."""

import ast
from threading import Lock

# CPython 3.11 counts the depth of the trees it builds in one place for all threads, and raises SystemError when two of
# them meet there (python/cpython issue 106905)
_ONE_AT_A_TIME = Lock()


def parsed(source: str) -> ast.Module:
    """Syntax tree of Python text, as `ast.parse`, but safe in threads.

    Raises:
        SyntaxError: the text is not Python.
    """
    with _ONE_AT_A_TIME:
        return ast.parse(source)
