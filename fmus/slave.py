"""Runs a composed block as an FMI 2.0 co-simulation slave of pythonfmu, with the standard library alone.

This text is copied into the script of every FMU, behind the composed equations. pythonfmu turns any exception into
fmi2Fatal and crashes on the next call, and cannot report an error from a setter. So nothing raises here: bad use is
logged with the variable, its value and the limit, and the next fmi2DoStep answers fmi2Discard.

Values live in one flat list, addressed by value reference: inputs, outputs, parameters. The calls that a master makes every
step are closures over that list and over the flattened equations of `fmus/specialise.py`, which is what makes them fast.
"""

import functools
import json
from collections.abc import Callable
from typing import Any

from fmus.slave_base import BaseSlave


class BlockSlave(BaseSlave):
    """A composed block as a slave; the subclass that the FMU's script defines fills in the tables.

    Attributes:
        equations: (Input, Parameters, State, Memory, start, begin, coefficients, output, advance).
        plain, with_effects: texts of the flattened step, without effects and with all of them.
        switches: (position among the parameters, off value) of each effect's key.
        takes_time: the equations want the communication time as last input.
        direct: positions among the outputs of those that follow an input at once.
        stale: an input has changed since the last step, so that these are to be computed when they are asked for.
        buffers: (length, resource file and column) of each array that block or effects remember.
        set_real, get_real, do_step: what pythonfmu calls every step; each phase of life installs its own.
    """

    equations: tuple[Any, ...] = ()
    plain = ""
    with_effects = ""
    switches: tuple[tuple[int, float], ...] = ()
    takes_time = False
    direct: tuple[int, ...] = ()
    buffers: tuple[tuple[int, str], ...] = ()
    set_real: Callable[[list[int], list[float]], None]
    get_real: Callable[[list[int]], list[float]]
    do_step: Callable[[float, float], bool]

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.time = 0.0
        self.stale = [False]
        self.install_setup()

    # The calls of each phase, as closures over the flat list

    def install_setup(self) -> None:
        """Before and during initialisation: everything but outputs can be set, outputs follow at once."""
        values, lows, highs = self.values, self.lows, self.highs
        first, last = self.n_inputs, self.n_inputs + self.n_outputs

        def set_real(refs: list[int], new: list[float]) -> None:
            for r, v in zip(refs, new):
                if 0 <= r < len(values) and not first <= r < last and lows[r] <= v <= highs[r]:
                    if r in self.integers:
                        self.refuse(f"{self.names[r]} is an Integer and cannot be set with fmi2SetReal")
                    else:
                        values[r] = v
                else:
                    self.refuse_value(r, v)

        def get_real(refs: list[int]) -> list[float]:
            if self.mode == "initialising":
                self.begin()
            return self.read(refs)

        def do_step(time: float, step: float) -> bool:
            self.refuse("fmi2DoStep before initialisation is complete")
            return False

        self.set_real, self.get_real, self.do_step = set_real, get_real, do_step
        self.running: Callable[[], tuple[Any, Any, float]] | None = None

    def install_access(self) -> None:
        """After initialisation: inputs can be set, everything can be read. Most masters handle one variable a call."""
        values, lows, highs, n = self.values, self.lows, self.highs, self.n_inputs
        count, last = len(values), n + self.n_outputs
        outputs = list(range(n, last))

        def set_real(refs: list[int], new: list[float]) -> None:
            if len(refs) == 1:
                r, v = refs[0], new[0]
                if 0 <= r < n and lows[r] <= v <= highs[r]:
                    values[r] = v
                    return
            for r, v in zip(refs, new):
                if 0 <= r < n and lows[r] <= v <= highs[r]:
                    values[r] = v
                else:
                    self.refuse_value(r, v)

        def get_real(refs: list[int]) -> list[float]:
            if len(refs) == 1:
                r = refs[0]
                if 0 <= r < count:
                    return [values[r]]
            elif refs == outputs:
                return values[n:last]
            found = [values[r] for r in refs if 0 <= r < count]
            return found if len(found) == len(refs) else self.read(refs)

        self.set_real, self.get_real = set_real, get_real
        if self.direct:
            self.install_direct(set_real, get_real)

    def install_direct(
        self,
        set_plain: Callable[[list[int], list[float]], None],
        get_plain: Callable[[list[int]], list[float]],
    ) -> None:
        """The same where outputs follow inputs at once: what is asked for after an input was set is that of this input."""
        values, lows, highs, n, stale = self.values, self.lows, self.highs, self.n_inputs, self.stale
        last = n + self.n_outputs

        def set_real(refs: list[int], new: list[float]) -> None:
            if len(refs) == 1:
                r, v = refs[0], new[0]
                if 0 <= r < n and lows[r] <= v <= highs[r]:
                    if values[r] != v:
                        stale[0] = True
                    values[r] = v
                    return
            before = values[:n]
            set_plain(refs, new)
            if values[:n] != before:
                stale[0] = True

        def get_real(refs: list[int]) -> list[float]:
            found = get_plain(refs)
            if stale[0]:
                now = self.at_once()
                found = [now[r - n] if n <= r < last else v for r, v in zip(refs, found)]
            return found

        self.set_real, self.get_real = set_real, get_real

    def at_once(self) -> list[float]:
        """Outputs as the inputs are now: after a step of length 0, which changes nothing but those that follow at once.

        Where the equations have no such step, a filter or a lag stands between, and the output stays.
        """
        Input, _, State, Memory, _, _, coefficients, output, advance = self.equations
        n = self.n_inputs
        found = self.values[n : n + self.n_outputs]
        try:
            x, m, _ = self.running() if self.running else ((), (), 0.0)
            u = Input(*self.values[:n])
            x, m = advance(State(*x), Memory(*m), u, self.p, coefficients(self.p, 0.0))
            y = output(x, u, m, self.p)
        except Exception:
            return found
        for i in self.direct:
            if -1e300 < y[i] < 1e300:
                found[i] = y[i]
        return found

    def install_running(self) -> None:
        """After initialisation: steps can be made, by the flattened text itself."""
        p, h = self.p, self.h
        coefficients = self.equations[6]
        on = any(p[i] != off for i, off in self.switches)
        stepper = self.compiled(self.with_effects if on else self.plain)

        def resized(time: float, step: float) -> bool:
            nonlocal h
            if not 0.0 < step < 1e6:
                self.refuse(f"step size {step!r} s is refused: it must be positive and below 1e6")
                return False
            if not h * (1.0 - 1e-12) < step < h * (1.0 + 1e-12):  # masters pass steps with rounding jitter
                renew(coefficients(p, step), step)
                h = step
            return True

        def failed(time: float, error: Exception | None) -> bool:
            n = self.n_inputs
            if self.takes_time and not -1e9 < time < 1e9:
                self.refuse(f"communication time {time!r} s is refused: it must be a number within 1e9")
            else:
                why = f"{self.names[n]} = {self.values[n]!r}" if error is None else error
                self.refuse(f"the step at t = {time!r} s failed: {why}")
            return False

        self.stale = [False]
        do_step, renew, running = stepper(
            self.values, p, coefficients(p, h), self.x, self.m, h, resized, failed, self.stale
        )
        self.do_step = self.step_after_refusal if self.failed else do_step
        self.running = lambda: (*running(), h)
        self.install_access()

    def refuse(self, message: str) -> None:
        """Log `message` as an error; from now on every step is discarded."""
        super().refuse(message)
        if self.mode == "running":
            self.do_step = self.step_after_refusal

    def step_after_refusal(self, time: float, step: float) -> bool:
        """A step that is discarded: something was refused before, and said then."""
        return False

    @staticmethod
    @functools.cache
    def compiled(text: str) -> Callable[..., tuple[Any, Any, Any]]:
        """The function `stepper` of a flattened text (see `fmus/specialise.py`)."""
        module: dict[str, Any] = {}
        exec(compile(text, "flattened equations", "exec"), module)
        return module["stepper"]

    # Life cycle

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """The start time; there is no end and no tolerance to keep."""
        if self.mode != "instantiated":
            self.refuse("fmi2SetupExperiment after fmi2EnterInitializationMode; reset first")
        elif not -1e9 < start_time < 1e9:
            self.refuse(f"start time {start_time!r} s is refused: it must be a number within 1e9")
        else:
            self.time = start_time

    def enter_initialization_mode(self) -> None:
        """From here outputs follow what is set."""
        if self.mode != "instantiated":
            self.refuse(f"fmi2EnterInitializationMode while {self.mode}; reset first")
            return
        self.mode = "initialising"
        self.begin()

    def exit_initialization_mode(self) -> None:
        """From here parameters stay and steps can be made."""
        if self.mode != "initialising":
            self.refuse("fmi2ExitInitializationMode without fmi2EnterInitializationMode")
            return
        if self.begin():
            self.mode = "running"
            self.install_running()

    def begin(self) -> bool:
        """State, memory and outputs from start values and inputs; True if that went well."""
        Input, Parameters, _, _, start, begin, coefficients, output, _ = self.equations
        n, last = self.n_inputs, self.n_inputs + self.n_outputs
        try:
            u = Input(*self.values[:n], *((self.time,) if self.takes_time else ()))
            self.p = Parameters(*self.values[last:])
            self.x = start(u, self.p)
            self.m = begin(self.x, u, self.p, [self.buffer(*b) for b in self.buffers])
            self.h = 1e-3
            coefficients(self.p, self.h)
            self.values[n:last] = output(self.x, u, self.m, self.p)
        except Exception as error:
            self.refuse(f"initialisation failed: {error}")
            return False
        return not self.failed

    def buffer(self, length: int, resource: str) -> list[float]:
        """An array of zeros, or a column of a CSV file among the FMU's resources."""
        return self.column(resource) if resource else [0.0] * length

    def tables(self) -> list[int]:
        """Positions in the memory of arrays that come from a resource; a block's arrays stand first."""
        return [i for i, (_, resource) in enumerate(self.buffers) if resource]

    def terminate(self) -> None:
        """The last values stay readable; steps are over until a reset."""
        self.mode = "terminated"
        self.do_step = self.step_after_end

    def step_after_end(self, time: float, step: float) -> bool:
        """A step that is refused."""
        self.refuse("fmi2DoStep after fmi2Terminate; reset first")
        return False

    # Whole state, saved and restored

    def _get_fmu_state(self) -> dict[str, Any]:
        state: dict[str, Any] = {
            "model": self.model,
            "mode": self.mode,
            "failed": self.failed,
            "time": self.time,
            "stale": self.stale[0],
        }
        state["values"] = list(self.values)
        if self.running is not None:
            x, m, h = self.running()
            state["x"], state["h"] = list(x), h
            state["m"] = [list(v) if isinstance(v, list) else v for v in m]
            for i in self.tables():
                state["m"][i] = None  # a table from a resource never changes
        return state

    def _set_fmu_state(self, state: Any) -> None:
        if not isinstance(state, dict) or state.get("model") != self.model:
            self.refuse(f"the state cannot be restored: it was not saved by {self.model}")
            return
        try:
            self.restore(state)
        except Exception as error:
            self.refuse(f"the state cannot be restored: {error!r}")

    def restore(self, state: dict[str, Any]) -> None:
        """Everything is read before anything is changed, so that a damaged state changes nothing."""
        _, Parameters, State, Memory, *_ = self.equations
        mode, failed, time = state["mode"], state["failed"] is True, float(state["time"])
        values = [float(v) for v in state["values"]]
        modes = ("instantiated", "initialising", "running", "terminated")
        if len(values) != len(self.values) or mode not in modes:
            raise ValueError("it does not fit")
        if "x" in state:
            x, h = State(*map(float, state["x"])), float(state["h"])
            saved = list(state["m"])
            for i in self.tables():
                saved[i] = self.buffer(*self.buffers[i])
            m = Memory(*([float(e) for e in v] if isinstance(v, list) else float(v) for v in saved))
            if not all(v - v == 0.0 for v in (*values, *x, h)) or h <= 0.0:
                raise ValueError("it holds values that are no numbers")
            self.x, self.m, self.h = x, m, h
            self.p = Parameters(*values[self.n_inputs + self.n_outputs :])
        self.mode, self.failed, self.time = mode, failed, time
        self.values[:] = values
        if "x" in state:
            self.install_running()
            self.stale[0] = state.get("stale") is True
        else:
            self.install_setup()
        if mode == "terminated":
            self.terminate()

    @staticmethod
    def _fmu_state_to_bytes(state: dict[str, Any]) -> bytes:
        return json.dumps(state).encode("utf-8")

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> Any:
        try:
            return json.loads(bytes(state).decode("utf-8"))
        except (ValueError, RecursionError):
            return {}  # refused when it is to be restored
