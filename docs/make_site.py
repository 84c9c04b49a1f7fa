"""Pages of the site that are not in docs/: README, changelog, security, and the references of commands and Python.

mkdocs.yml names this file as a hook.
"""

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

TOP = Path(__file__).resolve().parents[1]
PAGES = {"README.md": "readme.md", "CHANGELOG.md": "changelog.md", "SECURITY.md": "security.md"}
OUTSIDE = re.compile(r"\]\(\.\./([^)#]+)(#[^)]*)?\)")
API = """# Python

The functions of `import cosim`, then what they return. [python.md](../python.md) is the tutorial.

::: cosim.api
    options:
      show_root_heading: false
      members: [read_log, read_system, make_log, simulate, compare, calibrate, diagnose, identify, batch, check]

::: cosim.api.results
    options:
      show_root_heading: false

# What the other commands call

::: cosim.api.looking
    options:
      members: [facts_of]

::: cosim.api.matching
    options:
      members: [write_mapping, Matched]

::: cosim.api.building
    options:
      members: [build, validate, export, machine_model]

::: cosim.api.rigging
    options:
      members: [Asked, make_files]

::: cosim.api.numbers
"""


def on_files(files: Files, config: Any) -> Files:
    """Add the pages."""
    for source, target in PAGES.items():
        text = (TOP / source).read_text(encoding="utf-8")
        text = re.sub(r"\]\(docs/", "](", text)
        files.append(File.generated(config, target, content=_inside(text)))
    files.append(File.generated(config, "reference/cli.md", content=commands()))
    files.append(File.generated(config, "reference/api.md", content=API))
    for path in linked(files):
        files.append(File.generated(config, path, abs_src_path=str(TOP / path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Point what lies beside docs/ to its place in the site."""
    return markdown if page.file.src_uri.startswith("reference/") else _outside(markdown)


def linked(files: Files) -> list[str]:
    """Files beside docs/ that a page links to, as they are called from the top of the repository."""
    pages = [Path(str(f.abs_src_path)) for f in files.documentation_pages() if f.abs_src_path]
    found = {m[1] for page in pages for m in OUTSIDE.finditer(page.read_text(encoding="utf-8"))}
    return sorted(path for path in found if path not in PAGES and (TOP / path).is_file())


def _outside(text: str) -> str:
    def place(match: re.Match[str]) -> str:
        path, anchor = match[1], match[2] or ""
        if path in PAGES:
            return f"]({PAGES[path]}{anchor})"
        # a folder has no page: what cannot be found at all stays, and fails the build
        return f'](readme.md "{path} in the repository")' if (TOP / path).is_dir() else f"]({path}{anchor})"

    return OUTSIDE.sub(place, text)


def _inside(text: str) -> str:
    """Links of a page of the top level: to other such pages."""
    for source, target in PAGES.items():
        text = text.replace(f"]({source}", f"]({target}")
    return re.sub(r"\]\((LICENSE)\)", r"](readme.md)", text)


def commands() -> str:
    """Every command with its options, from the program itself."""
    import typer

    from cosim.cli import make_app

    lines = ["# Commands", "", "Made from the program: what `cosim COMMAND --help` says.", ""]
    group = typer.main.get_command(make_app())
    for name, command in sorted(group.commands.items()):  # type: ignore[attr-defined]
        lines += _command(f"cosim {name}", command)
    return "\n".join(lines) + "\n"


def _command(name: str, command: Any) -> list[str]:
    lines = [f"## {name}", "", _cell(command.help or "", " "), ""]
    rows = [_row(one) for one in command.params if not getattr(one, "hidden", False) and one.name != "help"]
    if rows:
        lines += ["| argument, option | |", "|---|---|", *rows, ""]
    for child, own in sorted(getattr(command, "commands", {}).items()):
        lines += [line.replace("## ", "### ", 1) for line in _command(f"{name} {child}", own)]
    return lines


def _row(one: Any) -> str:
    is_option = any(text.startswith("-") for text in one.opts)
    names = (
        ", ".join(f"`{text}`" for text in [*one.opts, *one.secondary_opts])
        if is_option
        else f"`{(one.metavar or one.name or '').strip('[]')}`"
    )
    return f"| {names} | {_cell(getattr(one, 'help', None) or '', ' ')} |"


def _cell(text: str, joint: str) -> str:
    return joint.join(text.split()).replace("|", "\\|").replace("<", "&lt;").replace("[", "\\[")
