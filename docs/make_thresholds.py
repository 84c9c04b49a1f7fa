"""Writes the tables of docs/thresholds.md from the code: ``python docs/make_thresholds.py``."""

import ast
import sys
from collections import defaultdict
from pathlib import Path
from types import ModuleType

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from cosim.diagnosis import thresholds as of_diagnosis
from cosim.inference import thresholds as of_inference
from cosim.inference.thresholds import Threshold, listed

TOP = Path(__file__).resolve().parent.parent
FILE = TOP / "docs" / "thresholds.md"
TABLES: dict[str, ModuleType] = {"diagnosis": of_diagnosis, "inference": of_inference}
END = "<!-- end of table -->"


def begin(title: str) -> str:
    """The mark before a table."""
    return f"<!-- table of {title}: python docs/make_thresholds.py -->"


def users(module: ModuleType) -> dict[str, list[str]]:
    """Name of a threshold -> the files that import it, below ``cosim``."""
    found = defaultdict(list)
    for path in sorted((TOP / "cosim").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if module.__name__ in text else ():
            if isinstance(node, ast.ImportFrom) and node.module == module.__name__:
                for alias in node.names:
                    found[alias.name].append(path.relative_to(TOP / "cosim").as_posix())
    return found


def shown(value: float | tuple[float, ...]) -> str:
    """A value, or a pair of them, in four digits."""
    return ", ".join(f"{v:.4g}" for v in (value if isinstance(value, tuple) else (value,)))


def row(one: Threshold, files: list[str]) -> str:
    """A line of the table."""
    value = f"{shown(one.value)} {one.unit}"
    return f"| `{one.name}` | {value} | {one.what} | {one.why} | {one.where} | {', '.join(files)} |"


def table(module: ModuleType) -> str:
    """The table of one module."""
    used = users(module)
    lines = ["| name | value | of what | why | measured on | used in |", "|---|---|---|---|---|---|"]
    return "\n".join([*lines, *(row(one, used[one.name]) for one in listed(module))])


def written(text: str) -> str:
    """The page with the tables between their marks renewed."""
    for title, module in TABLES.items():
        head, _, rest = text.partition(begin(title))
        _, _, tail = rest.partition(END)
        text = f"{head}{begin(title)}\n{table(module)}\n{END}{tail}"
    return text


if __name__ == "__main__":
    FILE.write_text(written(FILE.read_text(encoding="utf-8")), encoding="utf-8")
