"""Templates of the exports: jinja2 with delimiters that neither MATLAB, C nor Modelica uses."""

import math
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined

from cosim.errors import ModelError
from cosim.ssp.system import Value


def render(template: str, **context: Any) -> str:
    """A filled template of `cosim/export/templates`; a name it uses and does not get is an error of ours.

    Raises:
        ModelError: a text or number of the model cannot be written in the language.
    """
    environment = Environment(
        loader=FunctionLoader(_source),
        block_start_string="<%",
        block_end_string="%>",
        variable_start_string="<<",
        variable_end_string=">>",
        comment_start_string="<#",
        comment_end_string="#>",
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=StrictUndefined,
        autoescape=False,  # neither language is HTML; each value passes a filter of its language
    )
    environment.filters |= {"q": matlab_text, "s": modelica_text, "c": c_text, "n": number, "line": one_line}
    return environment.get_template(template).render(**context)


def _source(name: str) -> str:
    return (files("cosim.export") / "templates" / name).read_text(encoding="utf-8")


def one_line(text: str) -> str:
    """A text for a comment: line breaks and other white space become single spaces."""
    return " ".join(str(text).split())


def matlab_text(text: str) -> str:
    """A MATLAB character vector.

    Raises:
        ModelError: the text has a line break or another control character.
    """
    _refuse_control(text)
    return "'" + text.replace("'", "''") + "'"


def modelica_text(text: str) -> str:
    r"""A Modelica string.

    Raises:
        ModelError: the text has a line break or another control character.
    """
    _refuse_control(text)
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def c_text(text: str) -> str:
    r"""A string of C, in ASCII; what follows an escaped byte is no digit of it.

    Raises:
        ModelError: the text has a line break or another control character.
    """
    _refuse_control(text)
    plain = text.replace("\\", "\\\\").replace('"', '\\"').replace("?", "\\?").encode()
    return '"' + "".join(chr(b) if b < 128 else f"\\{b:03o}" for b in plain) + '"'


def _refuse_control(text: str) -> None:
    if any(ord(c) < 32 for c in text):
        raise ModelError(f"the text {text!r} has a control character, which cannot be exported: remove it")


def number(value: Value) -> str:
    """A number with all its digits, as both languages read it.

    Raises:
        ModelError: it is not finite.
    """
    if isinstance(value, float) and not math.isfinite(value):
        raise ModelError(f"the value {value} cannot be exported: give a finite one")
    return repr(value)


def template_bytes(name: str) -> bytes:
    """A file of the templates folder as it is."""
    return _source(name).encode()
