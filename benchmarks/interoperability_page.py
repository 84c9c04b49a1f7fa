"""The page of the table of clients: its rows, and what is said around them."""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from benchmarks.plain_host import TIMEOUT
from benchmarks.runner import machine
from benchmarks.single_fmus import Single, told
from cosim.ssp.build import SYSTEMS

H = 1e-3
TOLERANCE = 1e-9
"""Of a signal's range: the operations are the same but for the clock and C's own exp and tanh."""
KINDS = {"pythonfmu": "ssp", "native": "native/ssp", "native, FMI 3.0": "native_fmi3/ssp"}
BUILD = {
    "pythonfmu": "python build_fmus.py",
    "native": "python build_fmus.py --native",
    "native, FMI 3.0": "python build_fmus.py --native --fmi 3.0",
}
CLIENTS = {
    "cosim": "cosim.master.Runner",
    "fmpy": "fmpy, simulate_ssp",
    "ecos": "ecos",
    "libcosim": "libcosim",
    "fmucontainer": "FMUContainer, in fmpy's simulate_fmu",
    "host": "plain C host",
    "host+python": "plain C host, libpython preloaded",
}


@dataclass
class Row:
    """What one client does with one kind of FMU, over all systems.

    Attributes:
        kind, client: keys of `KINDS` and `CLIENTS`.
        loads, runs, agrees: yes or no, or None where it was not tried.
        ends: whether every process also ended cleanly, or None.
        difference: largest difference relative to a signal's range, or None.
        reasons: what the client said where it failed, or why it was not tried.
    """

    kind: str
    client: str
    loads: bool | None = None
    runs: bool | None = None
    agrees: bool | None = None
    ends: bool | None = None
    difference: float | None = None
    reasons: list[str] = field(default_factory=list)


INTRODUCTION = """# Which tools run our components

Which FMI tools load and run the FMUs and SSP packages of this project. Every cell is a run on the machine named below.
Made by `python benchmarks/interoperability.py`; do not edit by hand.

- Kinds: `pythonfmu` are the FMUs of `python build_fmus.py`, which need a Python on the host; `native` those of
  `python build_fmus.py --native`, the same equations in C, which need none; `native, FMI 3.0` those with `--fmi 3.0`. The
  packages are of SSP 1.0 in each case.
- Packages: the closed systems {systems}, unchanged, each run for {seconds:g} s at 1 ms.
- loads: the package is read, its FMUs are instantiated and make one step. runs: all {steps} steps.
- agrees: every compared signal is within {tolerance:g} of its range of the same blocks computed in plain Python under
  the client's own scheme (fmpy, ecos, libcosim and FMUContainer delay every wire by one step; ours and the C host do not).
- ends: every process ended without a crash after its last result.
- Each run has a process of its own. A crash or a time-out of {timeout:g} s counts as a failure.
"""

NOT_RUN = """
## Not run here

There is no MATLAB, no OpenModelica, no Dymola and no Windows at hand. [Export](export.md) says what was checked in their
stead.

- Simulink: `cosim export-simulink` writes a script; it was run in Octave against a stand-in for Simulink, and
  its S-functions against a stand-in for the header that they are compiled with.
- OpenModelica and Dymola: `cosim export-modelica` writes a package; its C functions were run event by event,
  and the Modelica compiler Rumoca checks its types, sizes and balance in the tests.
- OMSimulator (built from source once; what PyPI has of it loads its binary from elsewhere) and PyFMI (its source was read):
  what they met is right now ([native FMUs](native.md)), and was not run again.
- VDMCheck3 is in no package of PyPI or Debian, so none of our FMUs of FMI 3.0 has met it.
- fmpy's `simulate_ssp` takes every FMU for one of FMI 2.0. ecos runs those of FMI 3.0 by fmi4c, which says that
  fmi3GetVersion is missing and goes on.
- FMUContainer makes one FMU of a package, with a master of its own inside. It does not read the package's parameters (.ssv),
  so that FMUs run with their own start values.
- A process that ran ecos may die of SIGSEGV after all is done: TBB, when its last thread ends, unloads `libtcm` while the
  process's exit still runs in it. Loading `libtcm.so.1` with `RTLD_NODELETE` before `import ecospy` prevents it.
- Windows: the FMUs of the kind `pythonfmu` hold win64 binaries.
"""


def page(
    rows: Sequence[Row],
    validations: Mapping[str, tuple[int, list[str]]],
    steps: int,
    singles: Sequence[Single] = (),
    checks: Mapping[str, tuple[int, list[str]] | None] | None = None,
) -> str:
    """docs/interoperability.md."""
    text = INTRODUCTION.format(
        systems=", ".join(f"`{name}`" for name in SYSTEMS),
        seconds=steps * H, steps=steps, tolerance=TOLERANCE, timeout=TIMEOUT,
    )  # fmt: skip
    text += "\n| FMU kind | client | loads | runs | agrees | ends | largest difference |\n|---|---|---|---|---|---|---|\n"
    for row in rows:
        answers = [
            {True: "yes", False: "**no**", None: "not tried"}[a]
            for a in (row.loads, row.runs, row.agrees, row.ends)
        ]
        difference = "" if row.difference is None else f"{row.difference:.1e}"
        text += f"| {row.kind} | {CLIENTS[row.client]} | {' | '.join(answers)} | {difference} |\n"
    reasons = [f"- {row.kind}, {CLIENTS[row.client]}: {reason}" for row in rows for reason in row.reasons]
    if reasons:
        text += "\nWhat the failures said, and why something was not tried:\n\n" + "\n".join(reasons) + "\n"
    missing = [kind for kind in KINDS if kind not in validations]
    text += "".join(f"\nThe kind `{kind}` was not built: `{BUILD[kind]}`.\n" for kind in missing)
    text += "\nFMPy's `validate_fmu`:\n\n"
    for kind, (count, problems) in validations.items():
        text += f"- {kind}: {count} FMUs in the packages, {len(problems)} problems\n"
        text += "".join(f"  - {problem}\n" for problem in problems)
    text += "\nfmutool's check (FMU Manipulation Toolbox), of each FMU by itself:\n\n"
    for kind, found in (checks or {}).items():
        text += (
            f"- {kind}: "
            + ("not installed" if found is None else f"{found[0]} FMUs, {len(found[1])} problems")
            + "\n"
        )
        text += "".join(f"  - {problem}\n" for problem in (found[1] if found else []))
    text += told(list(singles))
    if any(row.client == "host" and row.kind == "pythonfmu" and not row.loads for row in rows):
        text += (
            "\nA host that is not Python, Simulink and OpenModelica among them, finds Python's symbols only\n"
            "if its shared library is loaded first; `cosim doctor` names the file. Native FMUs need nothing of the kind.\n"
        )
    text += NOT_RUN
    facts = machine() | {"system": " ".join([platform.system(), *platform.libc_ver()])}
    text += "\nMachine: " + ", ".join(f"{name} {value}" for name, value in facts.items()) + ".\n"
    return text
