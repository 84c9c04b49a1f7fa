"""The command line: finds the commands, and turns every outcome into a clear line and an exit code.

0 done; 1 done, and a threshold the user set was missed; 2 usage; 3 bad data or model file; 4 the simulation failed, or a
defect of ours; 5 an optional dependency is missing; 130 interrupted; 141 the reader of stdout went away.
"""

import contextlib
import importlib
import os
import pkgutil
import re
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

import cosim.commands
from cosim import console
from cosim.errors import CosimError, UsageError
from cosim.interrupts import ended_in_order

INTERNAL_ERROR = 4
INTERRUPTED = 130
OUTPUT_CLOSED = 141


# what to type, for a command that lacks its argument
EXAMPLES = {
    "check": "cosim check cosim-check.toml",
    "compare": "cosim compare examples/synthetic_demo.csv",
    "diagnose": "cosim diagnose examples/synthetic_demo.csv --out found",
    "info": "cosim info LOG.csv",
    "init": "cosim init LOG.csv",
    "machine": "cosim machine examples/machines/emps.toml --out axis",
    "report": "cosim report FOLDER, with the folder of a diagnosis",
    "simulate": "cosim simulate full_order --input LOG.csv",
    "validate": "cosim validate MODEL.fmu",
}
# words that people try, and the command that does it
MEANT = {
    "calibrate": "cosim compare LOG --calibrate fits a model's parameters",
    "fit": "cosim compare LOG --calibrate fits a model's parameters",
    "convert": "cosim init LOG writes a mapping, with which every command reads the log",
    "gui": "cosim open shows a page",
    "help": "cosim --help lists the commands",
    "plot": "cosim compare LOG --out DIR draws a log beside the model",
    "run": "cosim simulate MODEL runs a model",
    "version": "cosim --version shows it",
}


class _InterruptedError(Exception):
    """Ctrl-C: typer would turn it into a silent exit."""


class _Group(TyperGroup):
    def invoke(self, ctx: Any) -> Any:
        # typer would answer a closed pipe with 1, which means a missed threshold here
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise _InterruptedError from None
        except EOFError as error:  # which typer takes for a Ctrl-C
            raise RuntimeError(f"unexpected end of what another process says: {error}") from error
        except BrokenPipeError as error:
            raise console.OutputClosedError from error


def _print_version(wanted: bool) -> None:
    if wanted:
        from cosim.packages import project_version

        typer.echo(f"cosim {project_version()}")
        raise typer.Exit


def make_app() -> typer.Typer:
    """The typer application with every command of `cosim.commands`: each module's ``register(app)`` adds its own."""
    app = typer.Typer(
        name="cosim",
        cls=_Group,
        help="Co-simulation of a hydraulic crane's slew drive, compared with measured data.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )

    @app.callback()
    def root(
        version: Annotated[
            bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version.")
        ] = False,
        debug: Annotated[
            bool, typer.Option("--debug", help="Show the traceback of an error (also COSIM_DEBUG=1).")
        ] = False,
    ) -> None:
        """Options before the command; `main` reads --debug itself, since it must know it after a failure."""

    for module in sorted(found.name for found in pkgutil.iter_modules(cosim.commands.__path__)):
        importlib.import_module(f"cosim.commands.{module}").register(app)
    return app


def plain_texts(command: Any) -> Any:
    """A command whose help is shown as it is written: rich would take "[default: ...]" for markup, and leave it out."""
    from rich.markup import escape

    for part in (command, *command.params):
        if getattr(part, "help", None):
            part.help = escape(part.help)
    for inner in getattr(command, "commands", {}).values():
        plain_texts(inner)
    return command


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Runs the command line and exits the process.

    Args:
        arguments: the words after ``cosim``; by default those of the process.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    console.utf8_streams()
    console.believable_width()
    if "--json" in words and not {"--help", "-h"} & set(words):
        with console.json_only_stdout():
            code = _run(words, as_json=True)
    else:
        code = _run(words, as_json=False)
    sys.exit(_flushed(code))


def _run(words: list[str], as_json: bool) -> int:
    """Runs one command line and returns its exit code; no exception leaves."""
    struck: list[int] = []
    debug = "--debug" in words or os.environ.get("COSIM_DEBUG", "0") not in ("", "0")
    try:
        unwritable(words)
        with console.on_screen(), ended_in_order(struck):
            app = plain_texts(typer.main.get_command(make_app()))
            result = app.main(words, prog_name="cosim", standalone_mode=False)
        return result if isinstance(result, int) else 0
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else INTERNAL_ERROR
    except console.OutputClosedError:
        return OUTPUT_CLOSED
    except (KeyboardInterrupt, _InterruptedError, typer.Abort):
        return _failed("interrupted", INTERRUPTED, as_json)
    except CosimError as error:
        return _failed(str(error), error.exit_code, as_json, traceback.format_exc() if debug else None)
    except OSError as error:
        return _failed(
            _system_message(error), UsageError.exit_code, as_json, traceback.format_exc() if debug else None
        )
    except Exception as error:
        if struck:  # in the middle of an import, which makes another error of it
            return _failed("interrupted", INTERRUPTED, as_json)
        if hasattr(error, "format_message") and hasattr(error, "exit_code"):  # typer's own usage errors
            return _usage_failed(error, as_json)
        text = f"internal error, please report: {type(error).__name__}: {error}"
        trace = traceback.format_exc() if debug else None
        if not debug:
            text += " (COSIM_DEBUG=1 shows where)"
        return _failed(text, INTERNAL_ERROR, as_json, trace)


def unwritable(words: Sequence[str]) -> None:
    """Refuse a name that no JSON, picture or report can hold.

    Raises:
        UsageError: a word is not in the locale's letters.
    """
    for word in words:
        if any("\ud800" <= letter <= "\udfff" for letter in word):
            shown = word.encode("utf-8", "replace").decode()
            raise UsageError(f"the name '{shown}' is not in UTF-8: rename it, or use a UTF-8 locale")


def _system_message(error: OSError) -> str:
    """What the system refused, and where."""
    try:
        Path.cwd()
    except OSError:
        return "the current folder does not exist any more: change to another one"
    text = error.strerror or str(error)
    return f"{error.filename}: {text}" if error.filename else f"the system refused a file: {text}"


def _usage_failed(error: Any, as_json: bool) -> int:
    message = error.format_message()
    if not message:  # bare `cosim`: typer has shown the help
        return int(error.exit_code)
    context = getattr(error, "ctx", None)
    if context is not None:
        message += _meant(message, context.command)
        if message.startswith(("Missing argument", "Missing option")) and context.info_name in EXAMPLES:
            message += f" For example: {EXAMPLES[context.info_name]}"
        unknown = re.match(r"No such command '(\S+?)'", message)
        if unknown and unknown[1] in MEANT:
            message = f"No such command '{unknown[1]}': {MEANT[unknown[1]]}"
        message += f" (see '{context.command_path} --help')"
    return _failed(message, int(error.exit_code), as_json)


def _meant(message: str, command: Any) -> str:
    """For a word that is no argument, the option whose help names it as a value."""
    found = re.fullmatch(r"Got unexpected extra argument.*? \((\S+?)(?: .*)?\)", message)
    word = re.escape(found[1]) if found else ""
    for option in command.params if word else ():
        if option.opts[0].startswith("--") and re.search(rf"(?<![\w-]){word}(?![\w-])", option.help or ""):
            return f"; its option is meant: {option.opts[0]} {found[1] if found else ''}"
    return ""


def _failed(message: str, code: int, as_json: bool, trace: str | None = None) -> int:
    if trace:
        sys.stderr.write(trace)
    # where nobody can be told any more the exit code still says it
    with contextlib.suppress(OSError):
        console.fail(message)
    with contextlib.suppress(OSError):
        if as_json and not console.json_emitted():
            console.emit_json({"error": message, "exit_code": code})
    return code


def _flushed(code: int) -> int:
    """Flushes stdout while a closed pipe can still be answered; Python would print a message of its own at exit."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return OUTPUT_CLOSED
    return code
