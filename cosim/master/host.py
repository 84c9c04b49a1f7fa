"""Runs FMUs in this process: what a Runner does itself with FMUs of ours, and its child with those of others."""

import math
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.master import modules
from cosim.master.engine import Engine, EngineName, Room
from cosim.master.inputs import Sampler
from cosim.master.instance import WARNING, Instance
from cosim.master.plan import Plan
from cosim.ssp.system import Port, System, Value

Array = NDArray[np.float64]
Progress = Callable[[float], None] | None


@dataclass
class Task:
    """One run.

    Attributes:
        plan: the tables.
        grid: all communication points [s].
        sampler: the system's inputs at these points.
        settings: start values beside those of the system.
        whole: steps of size `step_size` [s]; the grid may have a shorter one more.
        engine: which loop.
        within: longest time that it may take where FMUs of others run [s].
    """

    plan: Plan
    grid: Array
    sampler: Sampler
    settings: Mapping[Port, Value]
    whole: int
    step_size: float
    engine: EngineName
    within: float = math.inf


class Host:
    """The instances of a system, in this process.

    Attributes:
        messages: what the FMUs logged in the last run at status Warning or worse.
        wall_time: duration of its loop [s].
    """

    def __init__(self, system: System) -> None:
        """Instantiate the FMUs.

        Raises:
            ModelError: a library cannot be loaded.
            SimulationError: an FMU cannot be instantiated.
        """
        self.messages: list[str] = []
        self.wall_time = 0.0
        self._instances: dict[str, Instance] = {}
        self._begun: tuple[Task, Array] | None = (
            None  # the first run's task and the beginning of what it recorded
        )
        self._tried = False
        try:
            for number, (name, component) in enumerate(system.components.items()):
                self._instances[name] = Instance(component, number)
        except BaseException:
            self.close()
            raise

    def run(
        self, task: Task, progress: Progress = None, room: Room = np.empty
    ) -> Generator[tuple[int, Array, Array], None, None]:
        """Simulate once from the start values; yields and raises as `cosim.master.engine.Engine.run`."""
        instances = [self._instances[name] for name in task.plan.order.names]
        loop = Engine(task.plan, instances, task.grid, task.sampler, room)
        try:
            _initialise(loop, task.settings)
            yield from loop.run(task.whole, task.step_size, task.engine, progress)
        finally:
            for instance in instances:
                instance.terminate()
            self.wall_time = loop.wall_time
            self.messages = [
                f"{i.name}: {m.text.strip()}" for i in instances for m in i.messages if m.status >= WARNING
            ]

    def close(self) -> None:
        """Free the FMUs."""
        for instance in self._instances.values():
            instance.close()
        self._instances.clear()
        modules.give_up()


def _initialise(loop: Engine, settings: Mapping[Port, Value]) -> None:
    for instance in loop.instances:
        instance.fresh()
        fmu = instance.component.fmu
        instance.begin(float(loop.grid[0]), float(loop.grid[-1]), fmu.tolerance)
        variables = fmu.variables
        own = {p.variable: v for p, v in settings.items() if p.component == instance.name}
        # after the experiment is set up: FMUs of 20-sim take their own start values there
        for name, value in {**instance.component.starts, **own}.items():
            instance.set_value(variables[name], value)
    for instance in loop.instances:
        instance.enter()
    loop.initialise(loop.sampler.points(0, 0)[0])
