"""Every `cosim ...` line that a document or a message shows can be typed: the command and its options exist.

Only the words are read, nothing runs. In a document a line is a span of code or a line of a code block, as usage it may
hold brackets for what may be left out and capitals for what the reader fills in.
"""

import re
import shlex
from functools import cache
from pathlib import Path

import pytest
import typer
from typer.core import TyperGroup

from cosim.cli import EXAMPLES, MEANT, main, make_app

TOP = Path(__file__).resolve().parents[2]
DOCUMENTS = [TOP / "README.md", *sorted((TOP / "docs").glob("*.md"))]
CODE = re.compile(r"^```\w*\n(.*?)^```|^((?:(?: {4}|\t).*\n)+)|`([^`\n]+)`", re.M | re.S)
# alone or behind a prompt, a path, a key of a YAML file; what stands after two spaces or a # is told beside it
LINE = re.compile(r"^\s*(?:\$ |- |run: |entry: |\S*/)*(?:python -m )?cosim +(\S.*)$")
SCRIPT = re.compile(r"python ((?:benchmarks|docs|examples)/\w+\.py|build_fmus\.py|check\.py)\b *([^`\n]*)")


@cache
def command_line():
    return typer.main.get_command(make_app())


def shown(text):
    """The lines ``cosim ...`` of a document, without what stands beside them."""
    found = []
    for block in CODE.finditer(text):
        code = next(filter(None, block.groups()), "")
        for line in re.sub(r"\n {10,}(?=\[)", " ", code).splitlines():  # a usage goes on
            match = LINE.match(line)
            if match:
                found.append(re.split(r" {2,}|\s#|\s&&\s|; ", match[1])[0].strip())
    return found


def fault(line):
    """What is wrong with the words of a line, or nothing."""
    words = shlex.split(re.sub(r"[\[\]]|\.\.\.| \| .*", "", line).replace("|", "_"))
    command = command_line()
    context = command.make_context("cosim", [], resilient_parsing=True)
    while isinstance(command, TyperGroup) and words and not words[0].startswith("-"):
        if words[0] == "COMMAND":
            return ""
        named = command.get_command(context, words[0])
        if named is None:
            return f"no command {words[0]}"
        command, words = named, words[1:]
        context = command.make_context(command.name, [], parent=context, resilient_parsing=True)
    context.resilient_parsing = (
        False  # it swallows what is wrong; a context is made without its arguments only with it
    )
    try:
        given, left, _ = command.make_parser(context).parse_args(list(words))
    except Exception as error:  # typer's own click raises its own
        message = str(getattr(error, "message", error))
        # an option may be named without a value, as in `cosim compare --out`
        return "" if message == f"Option '{words[-1]}' requires an argument." else message
    if left:
        return f"too many words: {' '.join(left)}"
    if not words:  # the command is named, not shown
        return ""
    absent = [
        p.opts[0] for p in command.params if p.required and p.opts[0].startswith("-") and p.name not in given
    ]
    return f"without its {', '.join(absent)}" if absent else ""


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_every_shown_command_exists_with_its_options(path):
    faults = [f"{line}: {fault(line)}" for line in shown(path.read_text(encoding="utf-8")) if fault(line)]
    assert faults == []


def test_lines_are_found_and_wrong_ones_noticed():
    assert sum(len(shown(path.read_text(encoding="utf-8"))) for path in DOCUMENTS) > 120
    assert shown("`cosim rig --effects`\n\n    cosim info A.csv     # a log\n") == [
        "rig --effects",
        "info A.csv",
    ]
    for wrong in (
        "nothing LOG",
        "info LOG --nothing",
        "identify nothing",
        "report ONE TWO",
        "machine A.toml",
    ):
        assert fault(wrong), wrong
    for right in (
        "diagnose LOG [LOG ...]",
        "compare --out",
        "identify drive LOG [LOG ...] --out found",
        "COMMAND --help",
    ):
        assert not fault(right), right


def test_every_command_a_message_names_exists():
    """In strings of the program, ``cosim`` and a small word is a command that the reader is told to type."""
    known = set(command_line().commands)
    beside = {"demo"}
    texts = [(p, p.read_text(encoding="utf-8")) for p in sorted((TOP / "cosim").rglob("*.py"))]
    named = {
        word
        for _, text in texts
        for word in re.findall(r"[\"'`(:, ]cosim ([a-z][a-z-]+)(?= [A-Z\[{<]| --|[`\"'])", text)
    }
    assert len(named) > 10
    assert named - known - beside == set()
    for line in [*EXAMPLES.values(), *(re.split(r" [a-z]+s ", text)[0] for text in MEANT.values())]:
        assert not fault(line.removeprefix("cosim ").split(", ")[0]), line


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_every_shown_script_exists_and_knows_its_options(path):
    for name, rest in SCRIPT.findall(path.read_text(encoding="utf-8")):
        script = TOP / name
        assert script.is_file(), name
        text = script.read_text(encoding="utf-8") + (TOP / "cosim" / "commands" / "build.py").read_text(
            "utf-8"
        )
        for option in re.findall(r"(?<![\w-])--[a-z-]+", re.split(r" {2,}|\s#", rest)[0]):
            assert f'"{option}"' in text or option[2:].replace("-", "_") + ":" in text, f"{name} {option}"


@pytest.mark.parametrize("words", [["machine", "A.toml"], ["compare"]])
def test_what_is_missing_is_shown_in_an_example(words, capsys):
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    assert f"For example: {EXAMPLES[words[0]]} (see" in capsys.readouterr().err


def test_every_command_is_run_on_other_pythons():
    from benchmarks.pythons import COMMANDS, WITH_EXTRAS

    texts = [text for text, _ in [*COMMANDS, *WITH_EXTRAS] if not text.startswith("--")]
    assert {text.split()[0] for text in texts} == set(command_line().commands)
    assert not {text: wrong for text in texts if not text.endswith(" --help") and (wrong := fault(text))}
