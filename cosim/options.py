"""Options that several commands share."""

from typing import Annotated

import typer

Language = Annotated[str, typer.Option("--language", help="Of the report: en, de.", metavar="LANGUAGE")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Show the tables behind the answer as well.")]
