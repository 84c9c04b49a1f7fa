"""Runs a composed block as an FMI 2.0 co-simulation slave of pythonfmu, with the standard library alone.

This text is copied into the script of every FMU, behind the composed equations. pythonfmu turns any exception into
fmi2Fatal and crashes on the next call, and cannot report an error from a setter. So nothing raises here: bad use is
logged with the variable, its value and the limit, and the next fmi2DoStep answers fmi2Discard.

Values live in one flat list, addressed by value reference: inputs, outputs, parameters. The calls that a master makes every
step are closures over that list, which is what makes them fast.
"""

import ctypes
import csv
import json
import os

from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

# pythonfmu's loader drops one reference too many to this module's globals at each instantiation; this text runs once more each time too
ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))


class BlockSlave(Fmi2Slave):
    """A composed block as a slave; the subclass that the FMU's script defines fills in the tables.

    Attributes:
        equations: (Input, Parameters, State, Memory, start, begin, coefficients, advance, output).
        names, starts, lows, highs: of all variables, by value reference.
        integers: value references of Integer variables.
        n_inputs, n_outputs: how many of each; parameters follow.
        takes_time: the equations want the communication time as last input.
        buffers: (length, resource file and column) of each array that block or effects remember.
    """

    equations: tuple = ()
    names: tuple = ()
    starts: tuple = ()
    lows: tuple = ()
    highs: tuple = ()
    integers: tuple = ()
    n_inputs = 0
    n_outputs = 0
    takes_time = False
    buffers: tuple = ()

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.mode = "instantiated"
        self.failed = False
        self.model = type(self).__module__  # unique: it holds a digest of this text
        self.values = list(self.starts)
        self.time = 0.0
        self.loaded = {}
        self.install_setup()

    # What went wrong: logged, remembered, never raised

    def refuse(self, message):
        """Log `message` as an error; from now on every step is discarded."""
        self.failed = True
        self.log(f"{self.instance_name}: {message}", Fmi2Status.error)

    def refuse_value(self, vr, value):
        """Log why a value was not taken."""
        if not 0 <= vr < len(self.names):
            self.refuse(f"there is no variable with value reference {vr}")
            return
        name = self.names[vr]
        if self.n_inputs <= vr < self.n_inputs + self.n_outputs:
            self.refuse(f"{name} is an output and cannot be set")
        elif vr >= self.n_inputs and self.mode in ("running", "terminated"):
            self.refuse(
                f"parameter {name} is fixed and cannot be set to {value!r} after initialisation; reset first"
            )
        else:
            limits = f"{self.lows[vr]!r} to {self.highs[vr]!r}"
            self.refuse(
                f"{name} = {value!r} is refused: it must be a number from {limits}; {self.values[vr]!r} is kept"
            )

    # The calls of each phase, as closures over the flat list

    def install_setup(self):
        """Before and during initialisation: everything but outputs can be set, outputs follow at once."""
        values, lows, highs = self.values, self.lows, self.highs
        first, last = self.n_inputs, self.n_inputs + self.n_outputs

        def set_real(refs, new):
            for r, v in zip(refs, new):
                if 0 <= r < len(values) and not first <= r < last and lows[r] <= v <= highs[r]:
                    if r in self.integers:
                        self.refuse(f"{self.names[r]} is an Integer and cannot be set with fmi2SetReal")
                    else:
                        values[r] = v
                else:
                    self.refuse_value(r, v)

        def get_real(refs):
            if self.mode == "initialising":
                self.begin()
            return self.read(refs)

        def do_step(time, step):
            self.refuse("fmi2DoStep before initialisation is complete")
            return False

        self.set_real, self.get_real, self.do_step = set_real, get_real, do_step
        self.get_running = None

    def install_running(self):
        """After initialisation: inputs can be set, outputs read, steps made."""
        Input, _, _, _, _, _, coefficients, advance, output = self.equations
        new_input = tuple.__new__
        values, lows, highs = self.values, self.lows, self.highs
        n, last, takes_time = self.n_inputs, self.n_inputs + self.n_outputs, self.takes_time
        p = self.p
        x, m = self.x, self.m
        c = coefficients(p, self.h)
        h = c.h

        def set_real(refs, new):
            for r, v in zip(refs, new):
                if 0 <= r < n and lows[r] <= v <= highs[r]:
                    values[r] = v
                else:
                    self.refuse_value(r, v)

        def get_real(refs):
            try:
                return [values[r] for r in refs]
            except IndexError:
                return self.read(refs)

        def do_step(time, step):
            nonlocal x, m, c, h
            if self.failed:
                return False
            try:
                if not -1e-12 * h < step - h < 1e-12 * h:  # masters pass steps with rounding jitter
                    if not 0.0 < step < 1e6:
                        self.refuse(f"step size {step!r} s is refused: it must be positive and below 1e6")
                        return False
                    c = coefficients(p, step)
                    h = step
                if takes_time and not -1e9 < time < 1e9:
                    self.refuse(f"communication time {time!r} s is refused: it must be a number within 1e9")
                    return False
                inputs = (*values[:n], time + step) if takes_time else values[:n]
                u = new_input(Input, inputs)
                x, m = advance(x, m, u, p, c)
                values[n:last] = output(x, u, m, p)
                if not -1e300 < values[n] < 1e300:
                    raise ArithmeticError(f"{self.names[n]} = {values[n]!r}")
            except Exception as error:
                self.refuse(f"the step at t = {time!r} s failed: {error}")
                return False
            return True

        def running():
            return x, m, h

        self.set_real, self.get_real, self.do_step = set_real, get_real, do_step
        self.get_running = running

    def read(self, refs):
        """Values by reference, with a message for one that does not exist."""
        known = range(len(self.values))
        for r in refs:
            if r not in known:
                self.refuse(f"there is no variable with value reference {r}")
        return [self.values[r] if r in known else float("nan") for r in refs]

    # Life cycle

    def setup_experiment(self, start_time, stop_time, tolerance):
        if self.mode != "instantiated":
            self.refuse("fmi2SetupExperiment after fmi2EnterInitializationMode; reset first")
        elif not -1e9 < start_time < 1e9:
            self.refuse(f"start time {start_time!r} s is refused: it must be a number within 1e9")
        else:
            self.time = start_time

    def enter_initialization_mode(self):
        if self.mode != "instantiated":
            self.refuse(f"fmi2EnterInitializationMode while {self.mode}; reset first")
            return
        self.mode = "initialising"
        self.begin()

    def exit_initialization_mode(self):
        if self.mode != "initialising":
            self.refuse("fmi2ExitInitializationMode without fmi2EnterInitializationMode")
            return
        if self.begin():
            self.mode = "running"
            self.install_running()

    def begin(self):
        """State, memory and outputs from start values and inputs; True if that went well."""
        Input, Parameters, _, _, start, begin, coefficients, _, output = self.equations
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

    def buffer(self, length, resource):
        """An array of zeros, or a column of a CSV file among the FMU's resources."""
        if not resource:
            return [0.0] * length
        tables = self.loaded
        if resource not in tables:
            file, _, column = resource.partition(":")
            try:
                with open(os.path.join(self.resources, file), newline="", encoding="utf-8") as stream:
                    rows = list(csv.reader(stream))[1:]
                tables[resource] = [float(row[int(column)]) for row in rows]
            except (OSError, ValueError, IndexError) as error:
                raise ValueError(f"{file} cannot be read: {error}") from None
            if not tables[resource]:
                raise ValueError(f"{file} has no rows below its header")
        return tables[resource]

    def tables(self):
        """Positions in the memory of arrays that come from a resource; a block's arrays stand first."""
        return [i for i, (_, resource) in enumerate(self.buffers) if resource]

    def terminate(self):
        """The last values stay readable; steps are over until a reset."""
        self.mode = "terminated"
        self.do_step = self.step_after_end

    def step_after_end(self, time, step):
        self.refuse("fmi2DoStep after fmi2Terminate; reset first")
        return False

    # Whole state, saved and restored

    def _get_fmu_state(self):
        state = {"model": self.model, "mode": self.mode, "failed": self.failed, "time": self.time}
        state["values"] = list(self.values)
        if self.get_running is not None:
            x, m, h = self.get_running()
            state["x"], state["h"] = list(x), h
            state["m"] = [list(v) if isinstance(v, list) else v for v in m]
            for i in self.tables():
                state["m"][i] = None  # a table from a resource never changes
        return state

    def _set_fmu_state(self, state):
        if not isinstance(state, dict) or state.get("model") != self.model:
            self.refuse(f"the state cannot be restored: it was not saved by {self.model}")
            return
        try:
            self.restore(state)
        except Exception as error:
            self.refuse(f"the state cannot be restored: {error!r}")

    def restore(self, state):
        """Everything is read before anything is changed, so that a damaged state changes nothing."""
        _, Parameters, State, Memory, *_ = self.equations
        mode, failed, time = state["mode"], state["failed"] is True, float(state["time"])
        values = [float(v) for v in state["values"]]
        if len(values) != len(self.values) or mode not in (
            "instantiated",
            "initialising",
            "running",
            "terminated",
        ):
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
        else:
            self.install_setup()
        if mode == "terminated":
            self.terminate()

    @staticmethod
    def _fmu_state_to_bytes(state):
        return json.dumps(state).encode("utf-8")

    @staticmethod
    def _fmu_state_from_bytes(state):
        try:
            return json.loads(bytes(state).decode("utf-8"))
        except (ValueError, RecursionError):
            return {}  # refused when it is to be restored

    # Other types: Integers are whole numbers in the same list; there are no Booleans and Strings

    def get_integer(self, refs):
        return [int(v) if self.is_integer(r) else 0 for r, v in zip(refs, self.read(refs))]

    def set_integer(self, refs, values):
        first = self.n_inputs + self.n_outputs
        for r, v in zip(refs, values):
            if self.is_integer(r):
                if (
                    self.mode in ("instantiated", "initialising")
                    and r >= first
                    and self.lows[r] <= v <= self.highs[r]
                ):
                    self.values[r] = float(v)
                else:
                    self.refuse_value(r, v)

    def is_integer(self, r):
        """True for an Integer variable; otherwise the call is refused."""
        if r in self.integers:
            return True
        if 0 <= r < len(self.names):
            self.refuse(f"{self.names[r]} is a Real, not an Integer")
        else:
            self.refuse(f"there is no variable with value reference {r}")
        return False

    def get_boolean(self, refs):
        self.refuse("there is no Boolean variable")
        return [False] * len(refs)

    def set_boolean(self, refs, values):
        self.refuse("there is no Boolean variable")

    def get_string(self, refs):
        self.refuse("there is no String variable")
        return [""] * len(refs)

    def set_string(self, refs, values):
        self.refuse("there is no String variable")

    def do_step(self, current_time, step_size):
        raise NotImplementedError  # each phase installs its own

    def to_xml(self, model_options=None):
        """The model description, which the builder laid beside this script."""
        from xml.etree import ElementTree

        return ElementTree.parse(os.path.join(self.resources, "model_description.xml")).getroot()
