"""The observer (2.15) in step with the link: its native FMU, or the same equations in Python where there is no compiler."""

import contextlib
import ctypes
import math
import shutil
import tempfile
from pathlib import Path
from typing import Any, Protocol

from cosim.errors import CosimError, SimulationError
from cosim.live.pace import PERIOD

DEG = math.pi / 180.0


class Estimator(Protocol):
    """What the loop needs of an observer."""

    kind: str

    def step(self, u: float, slew: float) -> tuple[float, float]:
        """Estimates of angle [deg] and velocity [deg/s] after a slot with the command `u` that ended at `slew` [deg]."""

    def close(self) -> None:
        """Frees what it holds."""


class NativeObserver:
    """The observer's FMU, in C.

    Raises:
        MissingCompilerError: there is no C compiler.
        ModelError, SimulationError: the FMU cannot be built or started.
    """

    kind = "native FMU"

    def __init__(self) -> None:
        from cosim.master.instance import DoStep, Instance, SetGetReal
        from cosim.native.build import build_native
        from cosim.ssp.read import read_system
        from fmus.build import composed_block

        self._folder = tempfile.mkdtemp(prefix="live_")
        self._system: Any = None
        self._instance: Any = None
        try:
            fmu = build_native(composed_block("observer"), Path(self._folder, "observer.fmu"))
            self._system = read_system(fmu)
            (component,) = self._system.components.values()
            self._instance = Instance(component)
        except BaseException:
            self.close()
            raise
        variables = component.fmu.variables
        # value references and values live as long as the instance, so that a step makes nothing new
        inputs = [variables[n].reference for n in ("u", "slew")]
        outputs = [variables[n].reference for n in ("slew_estimate", "slew_rate_estimate")]
        self._in_refs, self._out_refs = (ctypes.c_uint * 2)(*inputs), (ctypes.c_uint * 2)(*outputs)
        self._in, self._out = (ctypes.c_double * 2)(), (ctypes.c_double * 2)()
        places = (self._in_refs, self._in, self._out_refs, self._out)
        self._addresses = [ctypes.addressof(place) for place in places]
        self._set, self._get = SetGetReal(self._instance.setters[0]), SetGetReal(self._instance.getters[0])
        self._do = DoStep(self._instance.do_step)
        self._started, self._steps = False, 0

    def step(self, u: float, slew: float) -> tuple[float, float]:
        """See `Estimator`; the first call starts it at rest at the angle.

        Raises:
            SimulationError: the FMU refuses a value or a step.
        """
        self._in[0], self._in[1] = u, slew * DEG
        instance, (in_refs, entered, out_refs, found) = self._instance, self._addresses
        status = 0
        if not self._started:
            self._start()
        else:
            status = self._set(instance.pointer, in_refs, 2, entered)
            status = status or self._do(instance.pointer, self._steps * PERIOD, PERIOD, 1)
            self._steps += 1
        status = status or self._get(instance.pointer, out_refs, 2, found)
        if status:
            raise SimulationError(instance.report(f"failed with status {status}"))
        return self._out[0] / DEG, self._out[1] / DEG

    def _start(self) -> None:
        instance = self._instance
        instance.fresh()
        instance.begin(0.0)
        instance.enter()
        instance.transfer("Set", 0, ctypes.addressof(self._in_refs), 2, ctypes.addressof(self._in))
        instance.call("ExitInitializationMode")
        self._started = True

    def close(self) -> None:
        """See `Estimator`."""
        if self._instance is not None:
            self._instance.close()
            self._instance = None
        if self._system is not None:
            self._system.close()
            self._system = None
        shutil.rmtree(self._folder, ignore_errors=True)


class PlainObserver:
    """The block's own functions: a single step of numbers is faster so than through a compiled function's door."""

    kind = "equations in Python"

    def __init__(self) -> None:
        from fmus import observer

        self._block = observer
        self._x: Any = None
        self._p = observer.Parameters(*(v.start for v in observer.BLOCK.parameters.values()))
        self._c = observer.coefficients(self._p, PERIOD)

    def step(self, u: float, slew: float) -> tuple[float, float]:
        """See `Estimator`; the first call starts it at rest at the angle."""
        from fmus.contract import NoMemory

        block, entered = self._block, self._block.Input(u, slew * DEG)
        if self._x is None:
            self._x = block.start(entered, self._p)
        else:
            self._x = block.step(self._x, entered, NoMemory(), self._p, self._c)
        found = block.output(self._x, entered, NoMemory(), self._p)
        return found.slew_estimate / DEG, found.slew_rate_estimate / DEG

    def close(self) -> None:
        """See `Estimator`."""


def make_observer() -> Estimator:
    """The native FMU if it can be built, else the equations."""
    with contextlib.suppress(CosimError):
        return NativeObserver()
    return PlainObserver()
