"""Plain Modelica source of the blocks: checked by Rumoca and by the types of its declarations, evaluated, compared."""

import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "fmus"))

import modelica_source
from fmu_bench import run
from modelica_source import Package, System, TypeFaultError

from cosim.cli import main
from cosim.errors import ModelError
from cosim.export import prepare, write_modelica
from cosim.export.equations import Library
from cosim.master import Runner
from cosim.native.translate import Program
from cosim.paths import ssp_folder
from cosim.ssp.read import read_system
from cosim.ssp.write import write_ssp
from fmus import registry
from fmus.build import composed_block
from fmus.compose import compose
from fmus.contract import equation

HERE = Path(__file__).parent
STEPS = 200
# the numbers are the same but for expm1, which Modelica lacks (a few units in the last place), and what follows from it
CLOSE = 1e-11


def export(package, folder, **options):
    """The exported package.mo."""
    with read_system(package) as system:
        return write_modelica(prepare(system, **options), folder, equations=True)[0]


@pytest.fixture(scope="module")
def exported(built, tmp_path_factory):
    """File and parsed package of each system, read once."""
    found = {}

    def get(name):
        if name not in found:
            file = export(built[name], tmp_path_factory.mktemp("source") / name)
            found[name] = file, modelica_source.read(file)
        return found[name]

    return get


@pytest.mark.parametrize("name", ["simplified", "physical", "full_order_open"])
def test_system_gives_the_numbers_of_our_runner(name, built, exported):
    file, package = exported(name)
    assert package.check() > 60  # every function, called or not: types of all expressions
    times = np.arange(STEPS + 1) * 1e-3
    command = lambda t: 0.6 * np.cos(3.0 * t)  # noqa: E731
    inputs = {"u": (times, command(times))} if name.endswith("_open") else {}
    found = System(package, file, inputs={"u": command}).run(STEPS, 1e-3)
    with Runner(built[name]) as runner:
        expected = runner.run(STEPS * 1e-3, 1e-3, inputs=inputs)
    assert np.ptp(found["sensor.slew"]) > 1e-4  # it moves
    for signal in set(expected.signals) - {"u"}:
        wanted = expected.signals[signal]
        np.testing.assert_allclose(
            found[signal], wanted, rtol=0.0, atol=CLOSE * (np.ptp(wanted) or 1.0), err_msg=signal
        )


@pytest.fixture(scope="module")
def delayed(tmp_path_factory):
    """A package whose valve has a delay: the effect that remembers a list is written where it is on."""
    folder = tmp_path_factory.mktemp("delayed")
    values = {"dcv": {"tau_d": 0.0123}}
    package = write_ssp(ssp_folder() / "full_order.ssd", folder / "delayed.ssp", values=values, open=True)
    file = export(package, folder / "out")
    return file, modelica_source.read(file)


def block_run(file, package, component, values, rows):
    """Outputs of one component under given inputs, a row each step, and those of the same block in Python."""
    system = System(package, file, values={(component, n): v for n, v in values.items()})
    instance = system.instances[component]
    composed = composed_block(registry.FMU_OF_COMPONENT.get(component, component), component)
    now = dict(zip(composed.inputs, rows[0], strict=True))
    instance.wired = {n: (lambda n=n: now[n]) for n in composed.inputs}
    given = {n: instance.parameters.get(n, v.start) for n, v in composed.parameters.items()}
    python = run(composed, 1e-3, list(rows[0]), given)
    found, wanted = [], []
    instance.begin_event(0.0, True)
    for name in instance.phases[True]:
        instance.value(name)
    for k, row in enumerate(rows[1:], 1):
        now.update(zip(composed.inputs, row, strict=True))
        instance.begin_event(k * 1e-3, False)
        for name in instance.phases[False]:
            instance.value(name)
        found.append([instance.value(n) for n in composed.outputs])
        wanted.append(list(python.step(*row)))
    return np.array(found), np.array(wanted)


def lively(component, count=150):
    """Inputs with rests and reversals."""
    composed = composed_block(registry.FMU_OF_COMPONENT.get(component, component), component)
    rng = np.random.default_rng(5)
    size = [2.0 * v.nominal for v in composed.inputs.values()]
    rows = np.repeat(rng.normal(0.0, 1.0, (count // 5, len(size))), 5, axis=0) * size
    rows[rng.random(count) < 0.1] = 0.0
    return rows.tolist()


EFFECTS = {
    n: e for n, e in registry.effects().items()
    if e.component in ("dead_zone", "dcv", "continuity", "mechanical", "sensor") and not e.only
}  # fmt: skip


@pytest.mark.parametrize("effect", EFFECTS)
def test_each_effect_is_in_its_block(effect, exported, delayed):
    known = EFFECTS[effect]
    file, package = delayed if effect == "dcv.delay" else exported("full_order_open")
    for values in [{}, *({n: f.starts[0]} for n, f in known.forms.items())]:
        on = {n: f.starts[0] for n, f in known.free.items()} | values
        found, wanted = block_run(file, package, known.component, on, lively(known.component))
        span = np.maximum(np.abs(wanted).max(axis=0), 1e-300)
        assert np.all(np.abs(found - wanted) <= CLOSE * span)


def test_delay_is_a_parameter_only_where_it_is_on(exported, delayed):
    parameters = [System(p, f).instances["dcv"].parameters for f, p in (exported("full_order_open"), delayed)]
    assert ["tau_d" in p for p in parameters] == [False, True]
    assert parameters[1]["tau_d"] == 0.0123


def simple(text):
    """The package as Rumoca resolves it: it takes functions of one name in several packages for one another."""
    head, equations, rest = re.split(r"^  package Equations .*\n|^  end Equations;\n", text, flags=re.M)
    moved = []
    for name, body in re.findall(r'^    package (\w+) "[^\n]*\n(.*?)^    end \1;\n', equations, re.S | re.M):
        body = re.sub(r'"[^"\n]*"', '""', body)
        for kind, own in re.findall(r"^      (function|record) (\w+)", body, re.M):
            after = r"(?= |\(|;)" if kind == "record" else r"(?=\()"
            defined = rf"(?<=record ){own}$|(?<=function ){own}\b|(?<=end ){own}(?=;)"
            body = re.sub(rf"(?<![\w.]){own}{after}|{defined}", f"{name}_{own}", body, flags=re.M)
        moved.append(body)
        rest = re.sub(rf"Equations\.{name}\.(\w+)", rf"{name}_\1", rest)
    return head + "".join(moved) + rest


def rumoca_says(text, model):
    """What Rumoca says of a package: nothing if it parses, resolves all names and flattens.

    What follows then, the translation to equations, knows no loops that end early and no records: no fault of the package.
    """
    rumoca = pytest.importorskip("rumoca")
    session = rumoca.Session(roots=[str(HERE / "modelica_stub.mo")])
    try:
        session.loads(simple(text), model=model)
    except rumoca.RumocaError as error:
        return "" if re.match(r"todae failed: .* unsupported Flat semantic owner", str(error)) else str(error)
    return ""


@pytest.mark.parametrize("name", ["simplified", "physical", "full_order_open"])
def test_compiler_resolves_the_package(name, exported):
    text = exported(name)[0].read_text()
    system = name.removesuffix("_open")
    for model in [f"{system}.System"] + [f"{system}.Driven"] * name.endswith("_open"):
        assert rumoca_says(text, model) == ""


@pytest.mark.parametrize(
    ("replaced", "by", "message"),
    [
        ("connect(sensor.slew,", "connect(sensor.slow,", "slow"),
        ("      J = ", "      JJ = ", "JJ"),
        ("input Parameters p;", "input Parametres p;", "Parametres"),
        ("end for;", "end fore;", "parse"),
        ("x.theta", "x.thete", "thete"),
        ("end System;", "end Sistem;", "parse"),
    ],
)
def test_compiler_sees_a_fault(replaced, by, message, exported):
    text = exported("full_order_open")[0].read_text()
    assert replaced in text
    assert message in rumoca_says(text.replace(replaced, by, 1), "full_order.System")


# one function of each kind of fault, since a package takes seconds to parse
HARNESS = """package p
  constant Real step = 0.1;
  constant Real begin = 0.0;
  record R Real a; Real b[3]; end R;
  function two input Real x; output Real y; output Real z; algorithm y := x; z := x; end two;
  function f
    input Real x; input Integer n; input Boolean t; input R r;
    output Real y;
  protected
    Real s; Integer i; R w;
  algorithm
    y := 0.0; s := 1.0; i := 2; w := r;
    {statement}
  end f;
end p;
"""


@pytest.mark.parametrize("statement", [
    "s := x + n;", "i := n + 1;", "(s, y) := two(x);", "(, y) := two(x);", "w.b[i] := 2.0;", "s := r.b[n] * r.a;",
    "s := if t then 1 else 2.0;", "while t and x < 1.0 loop break; end while;",
    "for k in 0:n - 1 loop s := k; end for; return;",
])  # fmt: skip
def test_checker_takes_what_is_right(statement):
    assert Package(HARNESS.format(statement=statement)).check() == 2


@pytest.mark.parametrize("statement", [
    "i := x;", "i := n / 2;", "x := 1.0;", "s := t;", "s := q;", "s := two(x, x);", "(s, y, x) := two(x);",
    "s := 1.0 + two(x);",
    "s := r.c;", "s := r.b;", "s := r.b[x];", "s := if x then 1.0 else 2.0;", "if n then s := 1.0; end if;", "s := t + 1.0;",
    "y := unknown(x);", "for k in 0.5:2.0 loop s := k; end for;", "t := not x;", "w := R(x, n);", "s := max(x);",
])  # fmt: skip
def test_checker_sees_a_fault(statement):
    with pytest.raises(TypeFaultError):
        Package(HARNESS.format(statement=statement)).check()


def test_what_modelica_has_no_word_for_is_refused():
    import math
    from dataclasses import replace

    @equation
    def folded(slew, m, p):
        return math.erf(slew)

    known = registry.effects()["sensor.quantisation"]
    name = next(iter(known.fills))
    composed = compose(
        registry.block("sensor"), [replace(known, fills={name: folded}, memory={}, begin=None)]
    )
    message = r"block 'sensor' cannot be written in Modelica: function folded: line 'return math.erf\(slew\)'"
    with pytest.raises(ModelError, match=message):
        Library(Program(composed, "sensor_"))


def test_command_writes_the_blocks(built, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["export-modelica", str(built["full_order"]), "--out", str(tmp_path / "out"), "--source"])
    assert stop.value.code == 0
    files = sorted(str(f.relative_to(tmp_path / "out")) for f in (tmp_path / "out").rglob("*") if f.is_file())
    assert files == ["full_order/Resources/stimulus.txt", "full_order/package.mo", "simulate.mos"]
    assert "importFMU" not in (tmp_path / "out" / "simulate.mos").read_text()


def test_foreign_fmu_is_refused_by_name(built, tmp_path, capsys):
    from fmpy import extract

    file = tmp_path / "strange.fmu"
    with read_system(built["full_order"]) as system:
        prepared = prepare(system)
        file.write_bytes(next(i.data for i in prepared.fmus.values() if i.stem == "dcv"))
    folder = Path(extract(str(file), unzipdir=str(tmp_path / "x")))
    description = folder / "modelDescription.xml"
    description.write_text(description.read_text().replace("slew-cosim", "someone"))
    shutil.make_archive(str(tmp_path / "again"), "zip", folder)
    (tmp_path / "again.zip").rename(file)
    with pytest.raises(ModelError, match=r"strange.fmu is no FMU of this project.*--source"):
        export(file, tmp_path / "out")
