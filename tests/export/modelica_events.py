"""Runs an exported Modelica package as a Modelica tool would: reads its text, steps the FMUs through its C functions.

    python modelica_events.py LIBRARY PACKAGE.mo STEPS OUT.npz

At an event a tool evaluates each `when` once its inputs are known; a Hold hands over what it sampled at the event before.
"""

import ast
import ctypes
import re
import sys
from pathlib import Path

import numpy as np

NUMBER = r"[-+0-9.eE]+"


def read_package(text):
    """Models, instances, holds, connections and equations of an exported package."""
    models = {}
    for name, body in re.findall(r'^  model (\w+_cs_FMU) "[^"]*"\n(.*?)^  end \1;', text, re.S | re.M):
        arrays = re.findall(r"\{([^}]*)\}|fill\([0.]+, (0)\)", body.partition("initial equation")[2])
        cells = [[c.strip() for c in a.split(",")] if not empty else [] for a, empty in arrays]
        (
            reals,
            real_names,
            integers,
            integer_names,
            _,
            _,
            direct,
            direct_names,
            outputs,
            inputs,
            input_names,
            output_names,
        ) = cells[:12]
        assert (cells[12], cells[13], cells[14]) == (inputs, input_names, outputs)
        left = re.findall(r"^ +\(?([\w, ]+?)\)? = named\(", body, re.M)
        assert left == [", ".join(output_names)] * 2
        assert re.findall(r"(\w+) := y\[(\d+)\];", body) == [
            (n, str(k)) for k, n in enumerate(output_names, 1)
        ]
        parameters = dict(re.findall(rf"parameter (?:Real|Integer) (\w+)(?:\([^)]*\))? = ({NUMBER});", body))
        folder, identifier, guid = re.search(
            r'loadResource\("modelica://\w+/([^"]*)"\),\s*"([^"]*)", "([^"]*)", instanceName\)', body
        ).groups()
        models[name] = {
            "folder": folder, "identifier": identifier, "guid": guid, "parameters": parameters,
            "reals": (reals, real_names), "integers": (integers, integer_names),
            "direct": (direct, direct_names), "inputs": (inputs, input_names), "outputs": outputs,
            "output_names": output_names,
        }  # fmt: skip
    system = re.search(r"^  model System .*?^  end System;", text, re.S | re.M)[0]
    instances = {
        name: (model, dict(re.findall(rf"^      (\w+) = ({NUMBER}|\"[^\"]*\")[,)]", values, re.M)))
        for model, name, values in re.findall(r"^    (\w+_cs_FMU) (\w+)\(\n(.*?)\)\n", system, re.S | re.M)
        for values in [values + ")"]
    }
    return {
        "step": float(re.search(rf"step = ({NUMBER})", text)[1]),
        "begin": float(re.search(rf"begin = ({NUMBER})", text)[1]),
        "models": models,
        "instances": instances,
        "holds": re.findall(r"Internal\.Hold (\w+) ", system),
        "connections": re.findall(r"connect\(([\w.]+), ([\w.]+)\);", system),
        "equations": re.findall(r"^    ([\w.]+) = ([^;]+);", system, re.M),
        "inputs": re.findall(r"RealInput (\w+)", system),
    }


class Fmu:
    """An instance, called through the C functions of the package."""

    def __init__(self, library, package, model, values, name):
        self.library, self.model = library, model
        numbers = {**model["parameters"], **values}
        folder = str(package.parent / model["folder"])
        library.shim_open.restype = ctypes.c_void_p
        self.fmu = ctypes.c_void_p(
            library.shim_open(
                folder.encode(), model["identifier"].encode(), model["guid"].encode(), name.encode()
            )
        )
        reals, names = model["reals"]
        integers, integer_names = model["integers"]
        library.shim_start(
            self.fmu, ctypes.c_double(0.0), *vector(reals, int), doubles([float(numbers[n]) for n in names]),
            *vector(integers, int), (ctypes.c_int * len(integers))(*[int(numbers[n]) for n in integer_names]),
        )  # fmt: skip

    def call(self, function, ports, u, *times):
        y = (ctypes.c_double * len(self.model["outputs"]))()
        getattr(self.library, function)(
            self.fmu,
            *map(ctypes.c_double, times),
            *vector(ports, int),
            doubles(u),
            *vector(self.model["outputs"], int),
            y,
        )
        return dict(zip(self.model["output_names"], y, strict=True))


def vector(cells, kind):
    return (ctypes.c_int * len(cells))(*map(kind, cells)), ctypes.c_size_t(len(cells))


def doubles(values):
    return (ctypes.c_double * len(values))(*values)


class Events:
    """The events of a system model."""

    def __init__(self, library, package):
        self.library, self.parts = library, read_package(package.read_text())
        models, instances = self.parts["models"], self.parts["instances"]
        self.fmus = {n: Fmu(library, package, models[m], values, n) for n, (m, values) in instances.items()}
        self.fed = {target: source for source, target in self.parts["connections"]}
        self.equations = dict(self.parts["equations"])
        self.holds = set(self.parts["holds"])
        self.sampled = {}
        self.known = {}

    def value(self, port):
        """Value at this event, or None while it is not known yet."""
        if port in self.known:
            return self.known[port]
        if port.removesuffix(".y") in self.holds:
            # a Hold has sampled nothing before the start, where it hands its input over; from then on it is known
            return self.value(f"{port.removesuffix('.y')}.u")
        if port in self.fed:
            return self.value(self.fed[port])
        if port not in self.equations:
            return None
        name = re.search(r"[A-Za-z_]\w*\.\w+", self.equations[port])
        if name is None:
            return ast.literal_eval(self.equations[port])
        found = self.value(name[0])
        factor, offset = re.findall(rf"\(({NUMBER})\)", self.equations[port])
        return None if found is None else float(factor) * found + float(offset)

    def event(self, k, drive):
        """Evaluate one event; returns the outputs and inputs that are known then."""
        h = self.parts["step"]
        self.known = {name: drive(name, k * h) for name in self.parts["inputs"]}
        if k:
            self.known |= {f"{name}.y": self.sampled[name] for name in self.holds}
        waiting = set(self.fmus)
        while waiting:
            ready = [name for name in sorted(waiting) if self.evaluate(name, k, h)]
            assert ready, f"an algebraic loop through {sorted(waiting)}"
            waiting -= set(ready)
        if not k:
            for name, fmu in self.fmus.items():
                references, names = fmu.model["inputs"]
                u = doubles([self.value(f"{name}.{n}") for n in names])
                self.library.shim_leave(fmu.fmu, *vector(references, int), u)
        self.sampled = {name: self.value(self.fed[f"{name}.u"]) for name in self.holds}
        return {
            port: number for port, number in self.known.items() if port.partition(".")[0] not in self.holds
        }

    def evaluate(self, name, k, h):
        """Evaluate a component if its inputs are known."""
        fmu = self.fmus[name]
        references, names = fmu.model["inputs" if k else "direct"]
        u = [self.value(f"{name}.{n}") for n in names]
        if None in u:
            return False
        call, times = ("shim_step", (k * h, h)) if k else ("shim_initial", ())
        found = fmu.call(call, references, u, *times)
        if k == 3:  # a tool may evaluate an event again
            assert fmu.call(call, references, u, *times) == found
        self.known |= {f"{name}.{output}": number for output, number in found.items()}
        return True


def run(library, package, steps, drive=lambda name, time: 0.0):
    """Every output at every event: name -> shape (steps + 1,)."""
    events = Events(library, package)
    table = [events.event(k, drive) for k in range(steps + 1)]
    for fmu in events.fmus.values():
        library.shim_close(fmu.fmu)
    return {port: np.array([row[port] for row in table]) for port in table[0]}


if __name__ == "__main__":
    shim, file, count, out = sys.argv[1:5]
    level = float(sys.argv[5]) if len(sys.argv) > 5 else 0.0
    np.savez(
        out, **run(ctypes.CDLL(shim), Path(file), int(count), lambda name, time: level * np.cos(3.0 * time))
    )
