"""Python text into its syntax tree, from any thread, and what is found in one."""

import ast
from collections.abc import Iterator
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


def names(node: ast.AST, context: type[ast.expr_context]) -> set[str]:
    """Names that a piece of syntax reads (`ast.Load`) or assigns (`ast.Store`)."""
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, context)}


def calls(node: ast.AST) -> Iterator[tuple[str, ast.Call]]:
    """Calls of plain names, with the name."""
    for n in ast.walk(node):
        if isinstance(n, ast.Call) and isinstance(n.func, ast.Name):
            yield n.func.id, n


def collect(node: ast.AST, functions: dict[str, ast.FunctionDef], found: list[ast.FunctionDef]) -> None:
    """Append to `found` the functions that `node` calls, and those that these call."""
    for name, _ in calls(node):
        if name in functions and functions[name] not in found:
            found.append(functions[name])
            collect(functions[name], functions, found)
