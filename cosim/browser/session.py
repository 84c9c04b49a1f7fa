"""What has been dropped on the page, and the diagnosis that runs; a client of `cosim.api`.

Requests come in threads of the server; the diagnosis runs in the main thread, where Ctrl-C and its like reach it.
"""

import contextlib
import dataclasses
import datetime
import queue
import signal
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from contextvars import Context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim import api
from cosim.anysystem.command import any_system
from cosim.api.diagnosing import second_records_of
from cosim.api.results import DiagnosisResult
from cosim.browser.form import (
    Form,
    connector_form,
    crane_form,
    file_form,
    known_in,
    log_facts,
    machine_form,
    machine_of,
    of_another,
)
from cosim.browser.language import page_words, said, words
from cosim.browser.mapping import Content, FormError, mapping_of, remember, toml_text
from cosim.console import heard_by
from cosim.diagnosis.budget import parse_budget
from cosim.diagnosis.model.groups import MODELS
from cosim.errors import CosimError, DataError, HeadlessError, UsageError
from cosim.files import write_text
from cosim.logs import load_tracker
from cosim.logs.guess import DRIVERS
from cosim.logs.load import ENDINGS, open_source
from cosim.logs.mapping import load_mapping
from cosim.logs.markers import holds_markers
from cosim.logs.overview import Overview, overview
from cosim.logs.source import digest
from cosim.machines.table import machine_table
from cosim.paths import calling, examples_folder
from cosim.report.folder import ANSWER, read_answer
from cosim.report.language import ENGLISH, LANGUAGES

if TYPE_CHECKING:
    from cosim.logs import Log
    from cosim.logs.mapping import Mapping

SYSTEMS, TABLE = (".ssp", ".fmu"), ".toml"
LARGEST = {
    **dict.fromkeys(ENDINGS, 2 << 30),
    **dict.fromkeys(SYSTEMS, 512 << 20),
    TABLE: 1 << 20,
}  # bytes that are taken
WAIT = 0.2  # s between two looks at whether the page was closed
MACHINE = "machine"  # choice of a drive of its own, of which the log tells speed and lag
OWN = "own"  # choice of the model that was dropped, or that a dropped mapping names
KEPT = "mapping.toml"
LOG, MORE, HELD_OUT, TRACKER = ROLES = ("log", "more", "held_out", "external")
ALIKE = 0.5  # of its columns that a log has in common with another of the same machine
WORDS = {
    "full_order": "crane: valve, oil, mechanics",
    "simplified": "crane: gain and lag",
    "physical": "crane: valve, orifices and chambers, mechanics",
}
EXAMPLE = "synthetic_demo.csv"


@dataclasses.dataclass
class Dropped:
    """A file on the page.

    Attributes:
        path: where it lies.
        name: what people call it.
        ours: it is a copy that goes with the page or with its successor.
    """

    path: Path
    name: str
    ours: bool = True

    def forget(self) -> None:
        """Delete the copy."""
        if self.ours:
            self.path.unlink(missing_ok=True)


@dataclasses.dataclass(frozen=True)
class Beside:
    """A file that goes with the log.

    Attributes:
        file: itself.
        role: ``more`` is diagnosed together with the log, ``held_out`` judges the gain, ``external`` is the tracker's.
        samples, duration: its length; s, None where it has no clock.
        digest: SHA-256.
    """

    file: Dropped
    role: str
    samples: int
    duration: float | None
    digest: str


@dataclasses.dataclass
class Work:
    """One diagnosis.

    Attributes:
        state: idle, running, stopping, done, stopped or failed.
        text: what is going on.
        share: that is done, 0 to 1.
        began, ended: s of the monotonic clock.
        error: why it failed.
        lines: the answer.
        verdict: of the answer.
        folder: its results.
        report: whether report.html is there.
        warnings: what the user should know.
    """

    state: str = "idle"
    text: str = ""
    share: float = 0.0
    began: float = 0.0
    ended: float | None = None
    error: str = ""
    lines: list[str] = dataclasses.field(default_factory=list)
    verdict: str = ""
    folder: str = ""
    report: bool = False
    warnings: list[str] = dataclasses.field(default_factory=list)

    @property
    def runs(self) -> bool:
        """Whether it has not come to an end."""
        return self.state in ("running", "stopping")


@dataclasses.dataclass(frozen=True)
class Request:
    """A diagnosis that is asked for: the arguments of `cosim.diagnose`, and its mapping."""

    logs: list[Dropped]
    held_out: list[Dropped]
    external: Dropped | None
    model: Dropped | None
    mapping: str
    calibrate: bool
    budget: str | None


class Session:
    """What lies behind the page.

    Args:
        folder: temporary, for what is dropped.
        out: folder of results, one in it for each diagnosis.
        language: of page and reports; by default the browser's, once it has said so.

    Attributes:
        language: in use, None while nobody has said which.
        done: diagnoses of this session: folder and verdict.
        interrupted: Ctrl-C has ended a diagnosis.
    """

    def __init__(self, folder: Path, out: Path, language: str | None = None) -> None:
        self.folder, self.out, self.language = folder, out, language
        self.done: list[dict[str, str]] = []
        self.interrupted = False
        self._log: Dropped | None = None
        self._beside: list[Beside] = []
        self._model: Dropped | None = None  # a package or FMU
        self._table: Dropped | None = None  # a mapping or machine
        self._plain: Mapping | None = None
        self._content: Content = {}
        self._choice = next(iter(MODELS))
        self._seen: Overview | None = None
        self._facts: dict[str, Any] = {}
        self._form: Form | None = None
        self._picked = False  # somebody has chosen a model
        self._chosen = False  # somebody has diagnosed with the form as it is
        self._ports = False  # the signals are the connectors of any system
        self._revision = 0
        self._work = Work()
        self._asked: queue.Queue[Request] = queue.Queue()
        self._closed = threading.Event()
        self._taking = threading.Lock()  # one file or button at a time
        self._lock = threading.Lock()  # of what `state` shows

    # -- what the server calls

    def limits(self) -> dict[str, int]:
        """See `cosim.browser.server.Desk`."""
        return LARGEST

    def report(self) -> bytes | None:
        """See `cosim.browser.server.Desk`."""
        with self._lock:
            work = self._work
        file = Path(work.folder) / "report.html"
        return file.read_bytes() if work.report and file.is_file() else None

    def state(self, known: str = "") -> dict[str, Any]:
        """See `cosim.browser.server.Desk`."""
        with self._lock:
            work, now = self._work, time.monotonic()
            seconds = (
                (now if work.ended is None else work.ended) - work.began if work.state != "idle" else 0.0
            )
            heavy: dict[str, Any] = {}
            if known != str(self._revision):  # asked for several times a second while a diagnosis runs
                heavy["log"] = None if self._log is None else {"name": self._log.name, **self._facts_said()}
                heavy["form"] = None if self._form is None else self._form_said(self._form)
                heavy["beside"] = [
                    {"name": b.file.name, "role": b.role, "samples": b.samples, "duration": b.duration}
                    for b in self._beside
                ]
                heavy["words"] = page_words(self.language or ENGLISH)
            return {
                **heavy,
                "revision": self._revision,
                "language": self.language,
                "languages": LANGUAGES,
                "models": self._models(),
                "model": self._choice,
                "work": {**self._work_said(work), "seconds": seconds, "began": None, "ended": None},
                "closed": self._closed.is_set(),
            }

    def said(self, text: str) -> str:
        """See `cosim.browser.server.Desk`."""
        return said(text, self.language or ENGLISH)

    def _facts_said(self) -> dict[str, Any]:
        """The facts of the log, its warnings in the language of the page."""
        return self._facts | {"warnings": [self.said(text) for text in self._facts["warnings"]]}

    def _form_said(self, form: Form) -> dict[str, Any]:
        """The form as plain data, its words in the language of the page."""
        found = dataclasses.asdict(form)
        found["time"]["check"] = self.said(form.time.check)
        for row in found["rows"]:
            row |= {key: self.said(row[key]) for key in ("text", "why", "check")}
        return found

    def _work_said(self, work: Work) -> dict[str, Any]:
        """The diagnosis as plain data; each line of the answer as its question and what answers it."""
        found = dataclasses.asdict(work)
        parts = [line.partition(": ") for line in work.lines]
        found["lines"] = [[self.said(head), self.said(text)] for head, _, text in parts]
        found["warnings"] = [self.said(text) for text in work.warnings]
        return found | {"text": self.said(work.text), "error": self.said(work.error)}

    def take(self, file: Path, suffix: str, name: str, role: str = LOG) -> None:
        """See `cosim.browser.server.Desk`.

        Raises:
            CosimError: it is not what its name says, or a diagnosis runs.
        """
        self._take(Dropped(file, name), suffix, role)

    def take_own(self, file: Path, role: str = LOG) -> None:
        """A file named on the command line: it is read where it lies.

        Args:
            file: a log, model or mapping.
            role: of a log, one of `ROLES`.

        Raises:
            CosimError: it is not what its name says, or of no known kind.
        """
        suffix = next((known for known in LARGEST if file.name.lower().endswith(known)), None)
        if not file.is_file():
            raise DataError(f"{file}: {'this is a folder' if file.is_dir() else 'there is no such file'}")
        if suffix is None:
            raise UsageError(f"{file} is neither log nor model nor mapping: known are {', '.join(LARGEST)}")
        self._take(Dropped(file, file.name, ours=False), suffix, role)

    def choose(self, model: str) -> None:
        """Choose one of our models, or ``own``.

        Raises:
            UsageError: there is no such model.
        """
        if model not in (entry["value"] for entry in self._models()):
            raise UsageError(f"no model '{model[:40]}': one of {', '.join(MODELS)}, or drop a file")
        self._choice, self._picked = model, True
        self._ask_anew()

    def speak(self, language: str) -> None:
        """Choose the language of page and reports.

        Raises:
            UsageError: there is no such language.
        """
        words(language)
        with self._lock:
            self.language, self._revision = language, self._revision + 1

    def remove(self, place: Any) -> None:
        """Take a file that goes with the log away.

        Raises:
            UsageError: there is none at this place.
        """
        if not isinstance(place, int) or not 0 <= place < len(self._beside):
            raise UsageError("there is no such file")
        with self._lock:
            gone = self._beside.pop(place)
            self._revision, self._work = self._revision + 1, Work()
        gone.file.forget()

    def ask(self, what: str, given: dict[str, Any]) -> None:
        """See `cosim.browser.server.Desk`."""
        buttons: dict[str, Callable[[], None]] = {
            "model": lambda: self.choose(str(given.get("model"))),
            "diagnose": lambda: self._diagnose(given),
            "example": lambda: self._take_log(Dropped(examples_folder() / EXAMPLE, EXAMPLE, ours=False)),
            "remove": lambda: self.remove(given.get("place")),
            "language": lambda: self.speak(str(given.get("language"))),
            "stop": self.stop,
            "close": self.close,
        }
        press = buttons[what]
        if what in ("language", "stop", "close"):
            press()
            return
        with self._at_rest(), heard_by(None):
            press()

    def stop(self) -> None:
        """End the diagnosis that runs; what it has found is kept."""
        with self._lock:
            if self._work.state != "running":
                return
            self._work.state, self._work.text = "stopping", "stopping: what was found is being written"
        interrupt()

    def close(self) -> None:
        """End the session, and the diagnosis that runs."""
        self._closed.set()
        self.stop()

    # -- files

    @contextlib.contextmanager
    def _at_rest(self) -> Iterator[None]:
        with self._taking:
            if self._work.runs:
                raise UsageError("a diagnosis runs: stop it first")
            yield

    def _take(self, dropped: Dropped, suffix: str, role: str = LOG) -> None:
        try:
            with self._at_rest(), heard_by(None):
                if suffix in SYSTEMS:
                    self._take_model(dropped)
                elif suffix == TABLE:
                    self._take_table(dropped)
                elif role == TRACKER or is_tracker(dropped.path):
                    self._take_tracker(dropped)
                elif role == LOG or self._log is None:
                    self._take_log(dropped)
                else:
                    self._take_more(dropped, role)
        except CosimError as error:
            dropped.forget()
            raise type(error)(self._said(str(error), dropped)) from None
        except BaseException:
            dropped.forget()
            raise

    def _take_log(self, dropped: Dropped) -> None:
        found = overview(dropped.path, self._plain)
        if not any(column.finite.size for column in found.columns):
            raise DataError(f"{dropped.name} holds no column of numbers: is it a log?")
        if self._choice != OWN and not self._picked:
            self._choice = MACHINE if of_another(found) else next(iter(MODELS))
        # the next log of the same logger: what was chosen for the last one holds
        again = self._chosen and self._seen is not None and headings(found) == headings(self._seen)
        form = self._form if again and self._form is not None else self._form_for(found)
        facts = log_facts(found)
        old = [] if self._log is None else [self._log, *(b.file for b in self._beside)]
        for file in old:
            file.forget()
        with self._lock:
            self._log, self._beside = dropped, [] if old else self._beside
            self._seen, self._facts, self._form, self._chosen = found, facts, form, again
            self._revision, self._work = self._revision + 1, Work()

    def _take_more(self, dropped: Dropped, role: str) -> None:
        """Another log of the machine."""
        if role not in ROLES or self._seen is None or self._log is None:
            raise UsageError("there is no log: drop one first")
        found = overview(dropped.path, self._plain)
        names = {label for label, _ in headings(self._seen)}
        if len(names & {label for label, _ in headings(found)}) < ALIKE * len(names):
            raise DataError(
                f"{dropped.name} has other columns than {self._log.name}: logs that go together must be written the same way"
            )
        clock = found.clock
        self._add(dropped, role, found.samples, None if clock is None else clock.duration)

    def _take_tracker(self, dropped: Dropped) -> None:
        record = load_tracker(dropped.path)
        before = [b for b in self._beside if b.role == TRACKER]
        self._add(dropped, TRACKER, len(record), record.duration)
        for old in before:
            self.remove(self._beside.index(old))

    def _add(self, dropped: Dropped, role: str, samples: int, duration: float | None) -> None:
        own = digest(dropped.path)
        for other, theirs in [*((b.file, b.digest) for b in self._beside), (self._log, None)]:
            if other is not None and own == (theirs or digest(other.path)):
                raise DataError(f"{dropped.name} is the same record as {other.name}")
        with self._lock:
            self._beside.append(Beside(dropped, role, samples, duration, own))
            self._revision, self._work = self._revision + 1, Work()

    def _take_model(self, dropped: Dropped) -> None:
        with calling({dropped.path: dropped.name}), api.read_system(dropped.path):
            pass
        self._replace("_model", dropped)

    def _take_table(self, dropped: Dropped) -> None:
        plain = load_mapping(dropped.path)
        content = tomllib.loads(dropped.path.read_text(encoding="utf-8"))
        if plain.machine:
            machine_table(plain, dropped.path)
        named, parameters = plain.model_reference, content.get("compare", {}).get("parameters", [])
        if named is not None and named not in MODELS:
            if dropped.ours:
                content.pop("model")
            else:
                content["model"] = named
        if parameters and not dropped.ours:
            content["compare"]["parameters"] = [str((dropped.path.parent / p).resolve()) for p in parameters]
        elif parameters:
            raise UsageError(
                f"{dropped.name} names other files ({', '.join(map(str, parameters))}), which a dropped file cannot: start "
                "with 'cosim open --model FILE.toml' in its folder"
            )
        self._content, self._plain = content, plain
        self._replace("_table", dropped)

    def _replace(self, place: str, dropped: Dropped) -> None:
        before: Dropped | None = getattr(self, place)
        setattr(self, place, dropped)
        if before is not None:
            before.forget()
        self._choice = OWN
        self._ask_anew()

    def _models(self) -> list[dict[str, str]]:
        found = [{"value": name, "label": f"{self.said(WORDS[name])} ({name})"} for name in MODELS]
        found.append({"value": MACHINE, "label": self.said("another machine: the log tells speed and lag")})
        files = [dropped.name for dropped in (self._model, self._table) if dropped is not None]
        return [*found, {"value": OWN, "label": " + ".join(files)}] if files else found

    # -- form and mapping

    def _ask_anew(self) -> None:
        """Make the form again for another model."""
        form = None if self._seen is None else self._form_for(self._seen)
        with self._lock:
            self._form, self._revision, self._chosen = form, self._revision + 1, False
            self._work = Work()

    def _form_for(self, found: Overview) -> Form:
        self._ports = False
        if self._choice == MACHINE:
            return machine_form(found)
        if self._choice != OWN:
            return crane_form(found)
        if self._plain is not None:
            machine = machine_table(self._plain, "the mapping") if self._plain.machine else None
            ends = () if machine is None else (machine.input, machine.output)
            own = machine_form(found) if machine is not None else self._form_of_model(found)
            made = file_form(found, self._plain, ends, {row.signal: row for row in own.rows})
            made.numbers = own.numbers
            known_in(made.numbers, self._content.get("diagnose", {}))
            return made
        self._ports = self._is_foreign(found)
        return self._form_of_model(found)

    def _is_foreign(self, found: Overview) -> bool:
        """Whether the dropped model is of anybody's, whose signals are its connectors."""
        return self._model is not None and any_system(str(self._model.path), None, found.path) is not None

    def _form_of_model(self, found: Overview) -> Form:
        if self._model is None or not self._is_foreign(found):
            return crane_form(found)
        with calling({self._model.path: self._model.name}), api.read_system(self._model.path) as system:
            return connector_form(found, system)

    def _diagnose(self, given: dict[str, Any]) -> None:
        """Make a mapping of the form, and let the main thread diagnose with it.

        Raises:
            CosimError: there is no log, or the form is wrong; a `FormError` names the signal.
        """
        if self._log is None or self._seen is None or self._form is None:
            raise FormError("there is no log: drop one first")
        external = next((b.file for b in self._beside if b.role == TRACKER), None)
        if external is not None and self._ports:
            raise FormError(
                "the tracker goes with the crane alone: remove it, or give its angle as a column of the log"
            )
        own = self._choice == OWN
        model = self._model if own else None
        base: Content = dict(self._content) if own else {}
        if not self._seen.header and "file" not in base:
            base["file"] = {"header": False}
        if self._choice == MACHINE:
            base["signals"] = {name: {"text": f"applied {name}"} for name in DRIVERS}
        elif not own:
            base["model"] = self._choice
        elif (
            model is None
            and self._plain is not None
            and self._plain.model is not None
            and "model" not in base
        ):
            raise FormError(f"the mapping names the model '{self._plain.model}': drop that file too")
        if model is not None and self._ports:
            base.setdefault("model", model.name if model.ours else str(model.path.resolve()))
        if external is not None and any(b.role == MORE for b in self._beside):
            raise FormError(
                "the tracker goes with one log: remove it or the other logs, or take these to judge on"
            )
        content = mapping_of(given, self._form, self._seen, base)
        if self._choice == MACHINE:
            content["machine"] = machine_of(self._seen, content["signals"])
        text = toml_text(
            content, f"which column of {self._log.name} is which signal, as chosen in 'cosim open'"
        )
        trial = self.folder / KEPT
        write_text(trial, text)
        try:
            load_mapping(trial)
        except DataError as error:
            message = str(error).removeprefix(f"{trial}: ").removeprefix("'signals': ")
            rows = (r.signal for r in self._form.rows)
            row = next((r for r in rows if f"signals.{r}." in message or f"signal '{r}'" in message), "")
            row = row or ("time" if "'time" in message else "")
            raise FormError(message, row) from None
        budget = str(given.get("budget") or "").strip()
        if budget:
            try:
                parse_budget(budget)
            except UsageError as error:
                raise FormError(str(error).removeprefix(f"--budget {budget}: "), "budget") from None
        remember(self._form, content, self._seen)
        self._chosen = True
        request = Request(
            [self._log, *(b.file for b in self._beside if b.role == MORE)],
            [b.file for b in self._beside if b.role == HELD_OUT],
            external,
            model,
            text,
            given.get("calibrate") is True,
            budget or None,
        )
        with self._lock:
            self._work = Work("running", "reading the log", began=time.monotonic())
        self._asked.put(request)

    # -- the main thread

    def work(self) -> None:
        """Diagnose what is asked for until the page is closed.

        Raises:
            KeyboardInterrupt: Ctrl-C or its like; what a diagnosis had found is kept.
        """
        while not self._closed.is_set():
            try:
                with contextlib.suppress(queue.Empty):
                    self._run(self._asked.get(timeout=WAIT))
            except KeyboardInterrupt:
                # the button may come a moment too late, when its diagnosis has just ended
                with self._lock:
                    button, running = self._work.state == "stopping", self._work.runs
                if running:
                    self._settle(self._work, None)
                if not button:
                    self.interrupted = running or self.interrupted
                    raise

    def _run(self, asked: Request) -> None:
        work = self._work
        folder = self._new_folder()
        work.folder = str(folder)
        try:
            found = Context().run(self._diagnosed, asked, folder, work)
        except KeyboardInterrupt as stop:
            button = work.state == "stopping"
            self._settle(work, getattr(stop, "result", None))
            if not button:
                self.interrupted = True
                raise
        except CosimError as error:
            self._fail(work, self._said(str(error), asked.logs[0]))
        except Exception as error:
            self._fail(work, f"internal error, please report: {type(error).__name__}: {error}")
        else:
            self._keep(work, found, "done")

    def _diagnosed(self, asked: Request, folder: Path, work: Work) -> DiagnosisResult:
        """The diagnosis itself, in a context of its own, so that progress comes here and not to the terminal."""
        mapping = folder / KEPT
        write_text(mapping, asked.mapping)

        def hear(text: str, share: float) -> None:
            with self._lock:
                if work.state == "running":
                    work.text, work.share = text, max(work.share, share)

        def read(file: Dropped) -> "Log":
            return dataclasses.replace(api.read_log(file.path, mapping), source=Path(file.name))

        with heard_by(hear):
            logs, held_out = [read(file) for file in asked.logs], [read(file) for file in asked.held_out]
            if not held_out:
                second = second_records_of([file.path for file in asked.logs], mapping)
                pairs = zip(second, asked.logs, strict=False)  # a mapping without a table holds out none
                held_out = [dataclasses.replace(log, source=Path(file.name)) for log, file in pairs]
            tracker = None
            if asked.external is not None:
                found, name = load_tracker(asked.external.path), asked.external.name
                tracker = dataclasses.replace(found, source=Path(name))
        model = asked.model
        with calling({} if model is None else {model.path: model.name}):
            return api.diagnose(
                logs,
                None if model is None else model.path,
                mapping=mapping,
                external=tracker,
                held_out=held_out,
                calibrate=asked.calibrate,
                budget=asked.budget,
                out=folder,
                language=self.language or ENGLISH,
                progress=hear,
            )

    def _new_folder(self) -> Path:
        """A folder of results that was not there; its name is the time."""
        stamp = f"{datetime.datetime.now():%Y-%m-%d_%H-%M-%S}"
        for k in range(1000):
            folder = self.out / (stamp if k == 0 else f"{stamp}_{k}")
            try:
                folder.mkdir(parents=True)
            except FileExistsError:
                continue
            return folder
        raise UsageError(f"{self.out} is full of folders called {stamp}")

    def _settle(self, work: Work, result: DiagnosisResult | None) -> None:
        """A diagnosis that was stopped: what it left."""
        folder = Path(work.folder)
        if result is None and work.folder and (folder / ANSWER).is_file():
            result = DiagnosisResult(read_answer(folder), folder)
        if result is None:
            self._fail(work, "stopped before anything was found", "stopped")
        else:
            self._keep(work, result, "stopped")

    def _keep(self, work: Work, found: DiagnosisResult, state: str) -> None:
        # what the page shows beside them anyway: the folder, and in the report how sure and how much better
        shown = (
            "Report: ",
            "Results: ",
            *(("How sure", "Better: ", "Not better: ") if found.report is not None else ()),
        )
        lines, verdict = [line for line in found.lines() if not line.startswith(shown)], found.verdict
        # what stands under the log anyway, there or with the log's name before it
        known = {said for w in self._facts.get("warnings", ()) for said in (w, *self._with_names(w))}
        warnings = [w.removesuffix("; once more Ctrl-C leaves without") for w in found.warnings]
        with self._lock:
            work.lines, work.verdict, work.report = lines, verdict, found.report is not None
            work.warnings, work.share = [w for w in dict.fromkeys(warnings) if w not in known], 1.0
            work.state, work.ended = state, time.monotonic()
        self.done.append({"folder": work.folder, "verdict": verdict})

    def _with_names(self, warning: str) -> Iterator[str]:
        """A warning as it reads where several logs are diagnosed."""
        for file in (self._log, *(b.file for b in self._beside)):
            if file is not None:
                yield from (f"{file.name}: {warning}", f"{Path(file.name).stem}: {warning}")

    def _fail(self, work: Work, text: str, state: str = "failed") -> None:
        folder = Path(work.folder) if work.folder else None
        if folder is not None and folder.is_dir() and {p.name for p in folder.iterdir()} <= {KEPT}:
            (folder / KEPT).unlink(missing_ok=True)
            folder.rmdir()
            work.folder = ""
        with self._lock:
            work.error, work.state, work.ended = text, state, time.monotonic()

    def _said(self, text: str, dropped: Dropped) -> str:
        """A message with names in place of paths that nobody has chosen."""
        beside = (b.file for b in self._beside)
        for file in (dropped, self._log, self._model, self._table, *beside):
            if file is not None and file.ours:
                text = text.replace(str(file.path), file.name).replace(file.path.name, file.name)
        return text


def headings(found: Overview) -> list[tuple[str, str | None]]:
    """Heading and unit of each column."""
    return [(column.label.text, column.unit) for column in found.columns]


def is_tracker(file: Path) -> bool:
    """Whether a file is a tracker's record: its angle or its markers' positions, and none of the crane's command."""
    try:
        source = open_source(file)
    except HeadlessError:
        return False
    names = {name for label in source.labels for name in (label.name, label.alias)}
    return holds_markers(source) or ("slew_external" in names and "u" not in names)


def interrupt() -> None:
    """Ctrl-C for the main thread of this process, or SIGTERM where Ctrl-C is ignored."""
    import _thread

    number = signal.SIGTERM if signal.getsignal(signal.SIGINT) is signal.SIG_IGN else signal.SIGINT
    main = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main is not None:
        signal.pthread_kill(main, number)  # wakes it up where it waits, too
    else:
        _thread.interrupt_main(number)
