"""The closest known names, for messages about unknown ones."""

import difflib
from collections.abc import Iterable


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A clause such as `` (closest: 'theta', 'theta_0')``; empty where nothing is near."""
    names = list(known)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    near = near or [n for n in names if n.lower() == name.lower() or n.endswith(f".{name}")][:3]
    return f" (closest: {', '.join(repr(n) for n in near)})" if near else ""
