"""The wheel on other Pythons: in a bare virtual environment every command runs, then the tests with the extras.

    python -m benchmarks.pythons python3.13 ~/python3.14/bin/python     # interpreters of this host
    python -m benchmarks.pythons debian:trixie debian:sid               # Python 3.13 and 3.14 of Debian, as root

A Debian suite is bootstrapped by mmdebstrap into the work folder and entered by chroot; once made it is used again. Each
interpreter gets a row: commands that ran as they should, warnings of our own code, tests. What differs is printed whole.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
MIRROR = "http://deb.debian.org/debian"
EXTRAS = "dev,report,batch"
TESTS = ["tests/cli", "tests/fmus", "tests/logs", "tests/api"]
LONGEST_TRY = 5400.0
CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
KEPT = ("PIP_INDEX_URL", "PIP_DEFAULT_TIMEOUT", "http_proxy", "https_proxy")

# every command, in the order in which they find each other's files; with the exit code of an install without extras
COMMANDS: list[tuple[str, int]] = [
    ("--version", 0),
    ("--help", 0),
    ("doctor", 0),
    ("rig --duration '25 s' --hide 'mechanical.coulomb_friction:tau_c=300 N.m' --out log.csv", 0),
    ("info log.csv --plot", 0),
    ("init log.csv --out mapping.toml", 0),
    ("build", 0),
    ("info build/fmus/mechanical.fmu", 0),
    ("info full_order", 0),
    ("validate build/ssp/full_order.ssp build/fmus/mechanical.fmu", 0),
    ("simulate full_order --stop-time '2 s' --out run.mat", 0),
    ("info run.mat --json", 0),
    ("simulate full_order --stop-time '2 s' --out run.parquet", 0),
    ("compare log.csv", 0),
    ("compare log.csv --calibrate --free mechanical.b --starts 1", 0),
    ("diagnose log.csv", 0),
    ("report diagnosis", 5),
    ("check limits.toml --add log.csv --model full_order", 0),
    ("check limits.toml --junit junit.xml", 0),
    ("batch --set 'mechanical.J=900 kg.m2'", 5),
    ("identify drive log.csv", 0),
    ("identify mechanics log.csv", 0),
    ("identify kalman", 0),
    ("identify experiment slew --out slew.csv", 0),
    ("export-modelica full_order --out modelica", 0),
    ("export-simulink full_order --out simulink", 0),
    ("live --listen 0 --duration '1 s' --out live.csv", 0),
    ("machine --help", 0),
    ("reproduce --only 'fig. 4.16'", 5),
    ("open --help", 0),
    ("demo", 0),
]  # fmt: skip
WITH_EXTRAS = [("report diagnosis", 0), ("batch --sweep 'mechanical.J=700:900:2 kg.m2' --stop-time '1 s'", 0)]


@dataclass
class Host:
    """Where an interpreter runs.

    Attributes:
        python: its path, as seen from within.
        root: the folder that is its /, or None for this host.
        work: folder for environments and files, as seen from within.
    """

    python: str
    root: Path | None
    work: Path
    told: list[str] = field(default_factory=list)

    def outside(self, path: Path) -> Path:
        """A path within, as this process sees it."""
        return path if self.root is None else self.root / path.relative_to("/")

    def run(self, *words: object, cwd: Path, shell: bool = False) -> subprocess.CompletedProcess[str]:
        """Run a command within; stdout and stderr are texts."""
        command = ["bash", "-c", str(words[0])] if shell else [str(word) for word in words]
        environment = {name: os.environ[name] for name in KEPT if name in os.environ}
        environment |= {
            "HOME": str(self.work), "LANG": "C.UTF-8", "PYTHONWARNINGS": "default", "COLUMNS": "200",
            "PATH": "/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin", "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        }  # fmt: skip
        if CERTIFICATES.is_file():
            environment["PIP_CERT"] = environment["SSL_CERT_FILE"] = str(CERTIFICATES)
        if self.root is None:
            return subprocess.run(
                command,
                cwd=cwd,
                env=environment,
                capture_output=True,
                text=True,
                timeout=LONGEST_TRY,
                check=False,
            )
        inner = ["chroot", str(self.root), "/usr/bin/env", "-C", str(cwd), *command]
        return subprocess.run(
            inner, env=environment, capture_output=True, text=True, timeout=LONGEST_TRY, check=False
        )

    def must(self, *words: object, cwd: Path) -> str:
        """Run a command within that has to work; its stdout.

        Raises:
            SystemExit: it failed.
        """
        done = self.run(*words, cwd=cwd)
        if done.returncode:
            raise SystemExit(f"{' '.join(map(str, words))}\n{done.stdout[-4000:]}\n{done.stderr[-4000:]}")
        return done.stdout


@contextmanager
def opened(name: str, work: Path) -> Iterator[Host]:
    """An interpreter by its path, or Debian's of a suite such as ``debian:sid``."""
    if not name.startswith("debian:"):
        python = shutil.which(name)
        if python is None:
            raise SystemExit(f"there is no interpreter {name}")
        yield Host(python, None, work / re.sub(r"\W+", "_", name))
        return
    suite = name.partition(":")[2]
    root = work / suite
    if not (root / "usr/bin/python3").exists():
        # a mirror that stands still has signatures that are out of date
        subprocess.run(
            ["mmdebstrap", "--variant=minbase", "--mode=root", '--aptopt=Acquire::Check-Valid-Until "false"',
             "--include=python3,python3-venv,ca-certificates,gcc,libc6-dev", suite, str(root), MIRROR],
            check=True,
        )  # fmt: skip
    shutil.copy("/etc/resolv.conf", root / "etc/resolv.conf")
    if CERTIFICATES.is_file():
        shutil.copy(CERTIFICATES, root / CERTIFICATES.relative_to("/"))
    mounted = []
    try:
        for kind, place in (("proc", "proc"), ("tmpfs", "dev/shm")):
            (root / place).mkdir(parents=True, exist_ok=True)
            if not os.path.ismount(root / place):
                subprocess.run(["mount", "-t", kind, kind, str(root / place)], check=True)
                mounted.append(root / place)
        yield Host("/usr/bin/python3", root, Path("/w"))
    finally:
        for place in reversed(mounted):
            subprocess.run(["umount", str(place)], check=False)


def environment(host: Host, name: str, wheel: Path, extras: str = "") -> Path:
    """A new virtual environment with the wheel in it; its folder, as seen from within."""
    host.outside(host.work).mkdir(parents=True, exist_ok=True)
    inner = host.work / wheel.name
    shutil.copy(wheel, host.outside(inner))
    folder = host.work / name
    host.must(host.python, "-m", "venv", "--clear", folder, cwd=host.work)
    asked = f"{inner}[{extras}]" if extras else str(inner)
    host.must(folder / "bin/pip", "install", "-q", "--no-compile", asked, cwd=host.work)
    return folder


def commands(host: Host, bare: Path, listed: list[tuple[str, int]], where: Path) -> int:
    """Run commands of an environment; how many ended as they should."""
    good = 0
    for text, wanted in listed:
        done = host.run(f"{bare}/bin/cosim {text}", cwd=where, shell=True)
        own = [line for line in done.stderr.splitlines() if re.search(r"/(cosim|fmus)/.*Warning:", line)]
        trouble = done.returncode != wanted or "Traceback" in done.stderr
        good += not trouble
        if trouble:
            host.told.append(
                f"cosim {text}: exit code {done.returncode}, not {wanted}\n{done.stdout[-1500:]}\n{done.stderr[-3000:]}"
            )
        host.told += [f"cosim {text}: {line}" for line in own]
    return good


def tests(host: Host, folder: Path, chosen: list[str]) -> str:
    """What pytest says at its end of a checkout of HEAD."""
    checkout = host.work / "checkout"
    outside = host.outside(checkout)
    shutil.rmtree(outside, ignore_errors=True)
    outside.mkdir()
    packed = subprocess.run(["git", "archive", "HEAD"], cwd=TOP, capture_output=True, check=True).stdout
    subprocess.run(["tar", "-x", "-C", str(outside)], input=packed, check=True)
    done = host.run(
        folder / "bin/python", "-m", "pytest", "-q", "-n", "2", "--dist", "loadfile", *chosen, cwd=checkout
    )
    if done.returncode:
        host.told.append(done.stdout[-30000:] + done.stderr[-3000:])
    return (done.stdout.strip().splitlines() or ["no output"])[-1].strip("= ")


def main() -> None:
    """One row for each interpreter."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("pythons", nargs="+", help="interpreter, or debian:SUITE")
    parser.add_argument("--work", type=Path, help="folder to keep [default: a temporary one]")
    parser.add_argument(
        "--tests", nargs="*", default=TESTS, help="test files or folders; none: commands only"
    )
    asked = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as spare:
        work = (asked.work or Path(spare)).resolve()
        work.mkdir(parents=True, exist_ok=True)
        subprocess.run(
            [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(work / "dist"), str(TOP)],
            check=True,
        )
        wheel = max((work / "dist").glob("*.whl"), key=lambda path: path.stat().st_mtime)
        for name in asked.pythons:
            with opened(name, work) as host:
                begun = time.monotonic()
                bare = environment(host, "bare", wheel)
                installed = time.monotonic() - begun
                size = int(host.must("du", "-sm", bare, cwd=host.work).split()[0])
                where = host.work / "run"
                shutil.rmtree(host.outside(where), ignore_errors=True)
                host.outside(where).mkdir()
                row = {
                    "python": host.must(host.python, "--version", cwd=host.work).strip(),
                    "install_s": round(installed),
                    "install_MB": size,
                    "commands": f"{commands(host, bare, COMMANDS, where)} of {len(COMMANDS)}",
                }
                if asked.tests:
                    full = environment(host, "full", wheel, EXTRAS)
                    row["with_extras"] = f"{commands(host, full, WITH_EXTRAS, where)} of {len(WITH_EXTRAS)}"
                    row["tests"] = tests(host, full, asked.tests)
            print(f"== {name}", *host.told, sep="\n", flush=True)
            rows.append(row)
            print(json.dumps(row), flush=True)
    print(*(json.dumps(row) for row in rows), sep="\n")


if __name__ == "__main__":
    main()
