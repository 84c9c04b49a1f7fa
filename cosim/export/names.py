"""Names of components, files and variables as identifiers of another language, and what happens when two collide."""

import re
from collections.abc import Collection
from dataclasses import dataclass, field

from cosim.errors import ModelError

MATLAB_LENGTH = 63
"""namelengthmax of MATLAB."""
SIMULINK_PARAMETER_LENGTH = 55
"""Longest name of a parameter that the FMU block of Simulink imports."""

_MATLAB = """
break case catch classdef continue else elseif end for function global if otherwise parfor persistent return spmd
switch try while
"""
MATLAB_KEYWORDS = frozenset(_MATLAB.split())
_MODELICA = """
algorithm and annotation block break class connect connector constant constrainedby der discrete each else elseif
elsewhen encapsulated end enumeration equation expandable extends external false final flow for function if import
impure in initial inner input loop model not operator or outer output package parameter partial protected public
pure record redeclare replaceable return stream then true type when while within
"""
MODELICA_KEYWORDS = frozenset(_MODELICA.split())


def is_identifier(name: str) -> bool:
    """Whether a name is a letter followed by letters, digits and underscores, in ASCII."""
    return re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) is not None


def identifier(name: str, keywords: Collection[str], length: int | None = None) -> str:
    """The nearest identifier: other characters become underscores, a keyword gets one more; cut to `length`."""
    text = re.sub(r"[^A-Za-z0-9_]", "_", name)
    if not is_identifier(text):
        text = f"x{text}"
    if text in keywords:
        text += "_"
    return text if length is None else text[:length]


@dataclass
class Names:
    """Identifiers of one scope, each given once.

    Attributes:
        language: its name, for messages.
        keywords: words that are no identifiers.
        length: longest identifier, or None.
    """

    language: str
    keywords: Collection[str]
    length: int | None = None
    _taken: dict[str, str] = field(default_factory=dict)

    def reserve(self, name: str, what: str) -> None:
        """Keep an identifier that the export itself needs."""
        self._taken[name.lower()] = what

    def give(self, name: str, what: str) -> str:
        """The identifier for a name.

        Args:
            name: as in the package.
            what: what it names, for messages, such as ``component 'dcv'``.

        Raises:
            ModelError: another name has the same identifier; letter case does not tell them apart, since files of some
                systems do not either.
        """
        text = identifier(name, self.keywords, self.length)
        other = self._taken.setdefault(text.lower(), what)
        if other != what:
            raise ModelError(
                f"{other} and {what} would both be named '{text}' in {self.language}: rename one of them"
            )
        return text
