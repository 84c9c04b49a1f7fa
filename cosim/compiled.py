"""The compiled twin: the composed text of a block, compiled by numba and run over whole arrays.

Blocks of a chain without feedback can be run one after the other over the whole time axis, so a fit that changes a
parameter of one block runs again only that block and those behind it; two that feed back run in turns, step by step
(`CompiledPair`). A block whose effects are all off runs as the block alone: the same numbers bit for bit, three to five
times as fast. Compiled code is cached on disk by the text's digest.
"""

import ast
import atexit
import contextlib
import hashlib
import importlib.util
import inspect
import os
import re
import shutil
import sys
import tempfile
import threading
from collections.abc import Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import ModelError
from cosim.files import write_bytes
from cosim.interrupts import uninterrupted
from cosim.paths import cache_folder
from fmus import registry
from fmus.compose import Composed, compose
from fmus.contract import Buffer, Effect
from fmus.syntax import collect, parsed

Array = NDArray[np.float64]

IMPORTS = "import numpy as np\nfrom numba import njit\nfrom numba.extending import register_jitable\n"

RUN = '''
@njit(cache=True, nogil=True, no_cfunc_wrapper=True)
def run(x, m, p, c, inputs, outputs):
    """One step a column: `inputs` (n_inputs, n) of each step, `outputs` (n_outputs, n + 1) what follows it."""
    for k in range(inputs.shape[1]):
        u = Input({columns})
        x, m = advance(x, m, u, p, c)
        y = output(x, u, m, p)
{stores}
    return x, m
'''


PAIR = '''"""Two blocks in turns: the second is fed by the first, and feeds it back in the next step."""
import numpy as np
from numba import njit
from {first} import Input as Input_0, advance as advance_0, output as output_0
from {second} import Input as Input_1, advance as advance_1, output as output_1


@njit(cache=True, nogil=True, no_cfunc_wrapper=True)
def run(x0, m0, p0, c0, x1, m1, p1, c1, inputs, outputs_0, outputs_1):
    """One step a column: `inputs` (n,) of each step, `outputs` (n_outputs, n + 1) of both blocks."""
    for k in range(inputs.size):
        u0 = Input_0(inputs[k], outputs_1[{back}, k])
        x0, m0 = advance_0(x0, m0, u0, p0, c0)
        y0 = output_0(x0, u0, m0, p0)
        u1 = Input_1(y0[0])
        x1, m1 = advance_1(x1, m1, u1, p1, c1)
        y1 = output_1(x1, u1, m1, p1)
{stores}
'''


OVER = '''
@njit(cache=True, nogil=True, no_cfunc_wrapper=True)
def over_{slot}(values, m, p):
    """The slot {slot} applied to each value of a row."""
    result = np.empty_like(values)
    for k in range(values.size):
        result[k] = {slot}(values[k], m, p)
    return result
'''


def compiled_text(composed: Composed) -> str:
    """The composed text with numba's decorators, the loop over a log, and one over a row for each slot that maps a value.

    Only the loops have an entry from Python and a place in the cache: one for each function doubles the compiler's time.
    """
    text = composed.source.replace("import math\n", f"import math\n{IMPORTS}", 1)
    # numba tells unions of tuple types apart by name only: tuples of two blocks with equal names would be mixed in its cache
    own = rf"\1 = namedtuple('\1_{composed.digest}', \2)\n\1_{composed.digest} = \1"
    text = re.sub(r'(?m)^(\w+) = namedtuple\("\1", (.*)\)$', own, text)
    short = short_functions(composed)
    text = re.sub(r"\ndef (\w+)", lambda found: decorated(found[1], found[1] in short), text)
    columns = ", ".join(f"inputs[{i}, k]" for i in range(len(composed.block.inputs)))
    stores = "\n".join(f"        outputs[{i}, k + 1] = y[{i}]" for i in range(len(composed.block.outputs)))
    maps = [
        f.__name__
        for f in composed.block.equations
        if list(inspect.signature(f).parameters)[1:] == ["m", "p"]
    ]
    loops = "".join(OVER.format(slot=name) for name in maps if name in composed.block.slots)
    return text + RUN.format(columns=columns, stores=stores) + loops


def decorated(name: str, short: bool) -> str:
    """The head of a function, plain to Python and compiled into its compiled callers; a short one takes their place."""
    return f"\n@register_jitable(no_cfunc_wrapper=True{', forceinline=True' if short else ''})\ndef {name}"


def short_functions(composed: Composed) -> set[str]:
    """Functions without a loop, in a block whose step may enter a loop (an event inside the step).

    LLVM leaves the calls in such a block as they are, and handing on tuples of many fields costs more than the step itself;
    in the other blocks it does better by itself.
    """
    tree = parsed(composed.source)
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    looped = {
        name for name, f in functions.items() if any(isinstance(n, ast.For | ast.While) for n in ast.walk(f))
    }
    reached: list[ast.FunctionDef] = []
    collect(functions["advance"], functions, reached)
    return set(functions) - looped if looped & {f.name for f in reached} else set()


@cache
def _passing_folder() -> Path:
    """A folder for this process alone, where the cache cannot be used."""
    folder = tempfile.mkdtemp(prefix="cosim_cache_")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _module_file(name: str, content: bytes) -> Path:
    """The file of a generated module, in the cache folder or, where that cannot be used, in one for this process.

    Raises:
        ModelError: there is no place to write it to.
    """
    problem: OSError | None = None
    for folder in (cache_folder, _passing_folder):
        try:
            file = folder() / f"{name}.py"
            if not file.is_file() or file.read_bytes() != content:
                file.parent.mkdir(parents=True, exist_ok=True)
                write_bytes(file, content)
            if os.access(file.parent, os.W_OK):  # numba keeps the compiled code beside it
                return file
        except OSError as error:
            problem = error
    raise ModelError(
        f"the compiled model cannot be written ({problem.strerror if problem else 'write-protected'}): name a folder for"
        " it with COSIM_CACHE"
    )


# trials run in threads, and the second shall not find what the first has half loaded
_loading = threading.Lock()


class _Forgiving:
    """numba's cache of one function, for which a file that is damaged or cannot be written is no error: it compiles anew."""

    def __init__(self, inner: Any) -> None:
        self._inner = inner

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def load_overload(self, *arguments: Any) -> Any:
        try:
            return self._inner.load_overload(*arguments)
        except Exception:  # unpickling damaged bytes raises anything
            with contextlib.suppress(OSError):
                self._inner.flush()
            return None

    def save_overload(self, *arguments: Any) -> None:
        with contextlib.suppress(OSError):
            self._inner.save_overload(*arguments)


def load_compiled(composed: Composed) -> Any:
    """The compiled module of a composed block; written to the cache folder and imported from there.

    Raises:
        ModelError: there is no place to write it to.
    """
    return load_text(f"compiled_{composed.block.name}", compiled_text(composed))


def load_text(stem: str, text: str) -> Any:
    """The module of this text; written to the cache folder under stem and digest, and imported from there.

    Versions of this tool that write the text in another way do not take each other's place.

    Raises:
        ModelError: there is no place to write it to.
    """
    content = text.encode()
    name = f"{stem}_{hashlib.sha256(content).hexdigest()[:12]}"
    with _loading:
        return sys.modules[name] if name in sys.modules else _loaded(name, content)


def _loaded(name: str, content: bytes) -> Any:
    """A module that is not loaded yet."""
    file = _module_file(name, content)
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise ModelError(f"the compiled module {file} cannot be loaded")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:  # Ctrl-C, too: what is half loaded must not be found the next time
        del sys.modules[name]
        raise
    for function in vars(module).values():
        if hasattr(function, "enable_caching"):
            function._cache = _Forgiving(function._cache)
    return module


class CompiledBlock:
    """A block with effects, compiled.

    Attributes:
        composed: what it was made from.
        nominal: start value of every parameter, SI.
        outputs: names of the outputs.
    """

    def __init__(self, composed: Composed) -> None:
        self.composed = composed
        self.module = load_compiled(composed)
        self.nominal = {name: v.start for name, v in composed.parameters.items()}
        # declarations are read once: looking at type hints takes longer than a short run
        self.outputs = tuple(composed.outputs)
        self._lengths = [b.length for b in composed.memory.values() if isinstance(b, Buffer)]
        # step and values of the last run, parameters and coefficients that follow from these
        self._known: tuple[object, Any, Any] = (None, None, None)

    def parameters(self, values: Mapping[str, float]) -> Any:
        """Parameters of the block: nominal ones, those in `values` (SI) replaced.

        Raises:
            KeyError: a name that the block does not have; the message gives the closest.
        """
        self._refuse_unknown(values)
        return self.module.Parameters._make(map(float, {**self.nominal, **values}.values()))

    def _refuse_unknown(self, values: Mapping[str, float]) -> None:
        if not values.keys() <= self.nominal.keys():
            name, block = next(n for n in values if n not in self.nominal), self.composed.block.name
            raise KeyError(f"{block} has no '{name}'; {registry.suggestion(name, list(self.nominal))}")

    def buffers(self) -> list[Array]:
        """Fresh arrays for what block and effects remember."""
        return [np.zeros(length) for length in self._lengths]

    @cached_property
    def alone(self) -> "CompiledBlock":
        """The block without effects."""
        return CompiledBlock(compose(self.composed.block)) if self.composed.effects else self

    @cached_property
    def switches(self) -> dict[str, float]:
        """Parameter -> value at which an effect that adds to the equations is skipped."""
        return {
            e.key: self.nominal[e.key] for e in self.composed.effects if e.fills or e.remember is not None
        }

    def run(self, inputs: Array, h: float, values: Mapping[str, float], first: Array | None = None) -> Array:
        """Run over a whole log.

        Args:
            inputs: (n_inputs, n) inputs of each step: the value at the end of the step for a continuous signal, the value
                that holds for a held one.
            h: step, s.
            values: parameters that differ from nominal, SI.
            first: (n_inputs,) inputs at initialisation; by default the first column.

        Returns:
            (n_outputs, n + 1) outputs: at initialisation, then after each step.
        """
        block, own = self.acting(values)
        inputs = np.ascontiguousarray(inputs, dtype=np.float64)
        x, m, p, c, y = block.begun(inputs[:, 0] if first is None else first, h, own)
        outputs = np.empty((len(y), inputs.shape[1] + 1))
        outputs[:, 0] = y
        with uninterrupted():
            block.module.run(x, m, p, c, inputs, outputs)
        return outputs

    def acting(self, values: Mapping[str, float]) -> "tuple[CompiledBlock, dict[str, float]]":
        """The block without effects where they are all off, else the block itself; and the parameters of it in `values`."""
        self._refuse_unknown(values)
        if self.alone is not self and all(values.get(n, off) == off for n, off in self.switches.items()):
            known = self.alone.nominal
            return self.alone, {n: v for n, v in values.items() if n in known}
        return self, dict(values)

    def begun(self, inputs: Array, h: float, values: Mapping[str, float]) -> tuple[Any, Any, Any, Any, Any]:
        """State, memory, parameters, coefficients and outputs at initialisation, with these inputs (n_inputs,)."""
        module, key = self.module, (h, *values.items())
        known, p, c = self._known  # of a fit's runs most change another block
        if known != key:
            # coefficients in CPython: compiled exp differs in the last bit now and then, and the FMU computes them there
            p = self.parameters(values)
            c = module.coefficients(p, h)
            c = c._make(map(float, c))
            self._known = key, p, c
        u = module.Input._make(map(float, inputs))
        x = module.start(u, p)
        x = x._make(map(float, x))
        m = module.begin(x, u, p, self.buffers())
        return x, m, p, c, module.output(x, u, m, p)


class CompiledPair:
    """Two blocks that feed back, compiled: the first drives the second, which feeds it back with the step before.

    So does a master that steps them in the order of the wires, and so does the first block read it (`Block.reads`).

    Attributes:
        first, second: the blocks; the first one's second input bears the name of the second one's output that feeds it.
    """

    def __init__(self, first: CompiledBlock, second: CompiledBlock) -> None:
        self.first, self.second = first, second
        self.back = second.outputs.index(list(first.composed.inputs)[1])

    def run(
        self, inputs: Array, h: float, values: Mapping[str, float], others: Mapping[str, float], first: float
    ) -> tuple[Array, Array]:
        """Run over a whole log.

        Args:
            inputs: (n,) first input of the first block at the end of each step.
            h: step, s.
            values: parameters of the first block that differ from nominal, SI.
            others: those of the second.
            first: input at initialisation.

        Returns:
            (n_outputs, n + 1) outputs of each: at initialisation, then after each step.
        """
        block, theirs = self.second.acting(others)
        module = _pair(self.first, block, self.back)
        fed = 0.0
        for _ in range(2):  # what is fed back at the start does not depend on the pressure there
            x0, m0, p0, c0, y0 = self.first.begun(np.array([first, fed]), h, values)
            x1, m1, p1, c1, y1 = block.begun(np.array([y0[0]]), h, theirs)
            fed = float(y1[self.back])
        inputs = np.ascontiguousarray(inputs, dtype=np.float64)
        rows = [np.empty((len(y), inputs.size + 1)) for y in (y0, y1)]
        rows[0][:, 0], rows[1][:, 0] = y0, y1
        with uninterrupted():
            module.run(x0, m0, p0, c0, x1, m1, p1, c1, inputs, *rows)
        return rows[0], rows[1]


def _pair(first: CompiledBlock, second: CompiledBlock, back: int) -> Any:
    """The compiled module that runs two blocks in turns; its text names theirs."""
    names = [block.module.__name__ for block in (first, second)]
    stores = "\n".join(
        f"        outputs_{i}[{k}, k + 1] = y{i}[{k}]"
        for i, block in enumerate((first, second))
        for k in range(len(block.outputs))
    )
    text = PAIR.format(first=names[0], second=names[1], back=back, stores=stores)
    return load_text(f"compiled_{first.composed.block.name}_{second.composed.block.name}", text)


@cache
def compiled_block(name: str, component: str | None = None, extra: tuple[Effect, ...] = ()) -> CompiledBlock:
    """Block `name` with every effect of the library that acts on `component`, compiled once a process."""
    effects = registry.effects_on(component or name, name)
    return CompiledBlock(compose(registry.block(name), (*effects, *extra)))
