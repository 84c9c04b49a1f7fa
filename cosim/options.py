"""Options that several commands share."""

from typing import Annotated

import typer

Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Show the tables behind the answer as well.")]
