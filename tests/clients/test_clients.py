"""Our closed packages, unchanged, in fmpy, ecos, libcosim and FMUContainer.

Each agrees with the same blocks under its scheme.
"""

import importlib.util
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from jacobi import SCHEMES, read_parts, simulate

from benchmarks.engines import MODULES, environment, run_engine
from cosim.paths import ssp_folder
from cosim.ssp.stimulus import stimulus_csv
from cosim.ssp.write import write_archive, write_ssp

pytestmark = pytest.mark.clients

STEPS = 1200
H = 1e-3
DRIVE = ("compensator.demand", "dead_zone.demand")
SENSED = ("sensor.slew", "observer.slew_estimate", "observer.slew_rate_estimate")
CHAIN = ("dcv.spool", "continuity.p_load", "continuity.p_supply", "mechanical.theta", "mechanical.omega")
SIGNALS = {
    "full_order": (*DRIVE, *CHAIN, *SENSED),
    "physical": (*DRIVE, *CHAIN, *SENSED),
    "full_order_extended": (*DRIVE, *CHAIN, *SENSED, "observer.disturbance"),
    "simplified": (*DRIVE, "simplified.theta", *SENSED),
    "position_loop": ("reference.reference", "controller.u", *DRIVE, *CHAIN, *SENSED),
    "position_loop_observer": ("reference.reference", "controller.u", *DRIVE, *CHAIN, *SENSED),
}
# every parameter differs from its nominal value and matters in the 1.2 s; each effect is on
CHANGED = {
    "stimulus": {"gain": 0.9},
    "compensator": {"form": 2.0, "m_r": 1.1, "b_l": -0.35},
    "dead_zone": {"b_r": 0.40, "b_l": -0.38, "play": 0.02, "limit": 0.45},
    "dcv": {"K": 2.5e-3, "w0": 22.0, "zeta": 0.6, "x_0": 1e-4, "v_max": 0.02, "x_max": 1.1e-3, "tau_d": 0.015},
    "continuity": {"K_c": 5e8, "T": 0.12, "c_beta": 0.2, "c_l": 0.1, "a_q": 0.1, "k_s": 1e9, "p_c": 5e4},
    "mechanical": {
        "J": 900.0, "b": 25e3, "tau_c": 30.0, "tau_s": 20.0, "tau_g": 80.0, "tau_r": 15.0, "gap": 1e-4, "mu": 0.3,
        "theta_0": 0.1,
    },
    "sensor": {"gain": 1.02, "bias": 0.01, "drift": 1e-3, "quantum": 1e-5, "tau_l": 0.02, "p_drop": 0.2},
    "observer": {"a": 4.0, "p1": -15.0},
}  # fmt: skip


def command():
    """Starts away from zero, so that a wrong start-up delay shows, and takes both directions."""
    times = np.arange(STEPS + 1) * H
    return times, np.select([times < 0.5, times < 0.9], [0.3 + 0.3 * np.sin(5.0 * times), -0.6], -0.3)


@pytest.fixture(scope="session")
def packages(tmp_path_factory):
    folder = tmp_path_factory.mktemp("packages")
    stimulus = stimulus_csv(*command())
    written = {
        name: write_ssp(ssp_folder() / f"{name}.ssd", folder / f"{name}.ssp", stimulus=stimulus)
        for name in SIGNALS
    }
    extended = write_ssp(
        ssp_folder() / "full_order.ssd", folder / "extended.ssp", stimulus=stimulus, values=CHANGED
    )
    with zipfile.ZipFile(written["full_order"]) as nominal, zipfile.ZipFile(extended) as other:
        mixed = {name: nominal.read(name) for name in nominal.namelist()}
        mixed |= {name: other.read(name) for name in other.namelist() if name.endswith(".ssv")}
    # FMUs with nominal start values, bindings with the changed ones: only a client that obeys bindings sees the change
    return written | {"extended": extended, "bound": write_archive(mixed, folder / "bound.ssp")}


def installed(name):
    """A client, where it is installed."""
    if importlib.util.find_spec(MODULES[name]) is None:
        pytest.skip(f"{MODULES[name]} is not installed: pip install 'slew-cosim[clients]'")
    return name


@pytest.fixture(params=MODULES)
def engine(request):
    return installed(request.param)


def largest_difference(engine, found, expected, signals):
    """Largest difference relative to the signal's range, and the stamps of that engine's rows."""
    first = 0 if engine in ("ecos", "fmucontainer") else 1
    worst = {}
    for name in signals:
        wanted = expected[name][first:]
        assert found[name].shape == wanted.shape
        span = np.ptp(wanted) or 1.0
        worst[name] = float(np.max(np.abs(found[name] - wanted)) / span)
    stamps = np.arange(1 if engine == "libcosim" else 0, STEPS + (engine != "fmpy")) * H
    np.testing.assert_allclose(found["time"], stamps, rtol=0.0, atol=1e-9)
    return worst


# every client runs the loop around the drive in every run, with changed parameters the drive alone too; each other system
# runs in one of them, and in the others with the slow tests
EVERYWHERE = ("position_loop_observer",)
QUICK = {
    "full_order": "fmucontainer",
    "physical": "fmpy",
    "full_order_extended": "ecos",
    "simplified": "libcosim",
    "position_loop": "fmpy",
}
AGREE = [
    pytest.param(e, s, marks=() if s in EVERYWHERE or QUICK[s] == e else pytest.mark.slow, id=f"{e}-{s}")
    for e in MODULES
    for s in SIGNALS
]


@pytest.mark.parametrize(("engine", "system"), AGREE, indirect=["engine"])
def test_system_agrees_with_the_blocks_under_the_master_s_scheme(engine, system, packages):
    signals = SIGNALS[system]
    found, _ = run_engine(engine, packages[system], steps=STEPS, h=H, signals=signals, timeout=600)
    expected = simulate(packages[system], STEPS, H, signals, **SCHEMES[engine])
    worst = largest_difference(engine, found, expected, signals)
    # the same floating-point operations but for the clock, which some masters accumulate
    assert max(worst.values()) < 1e-9, worst


def test_the_start_up_delay_shows(packages):
    """Were the two schemes alike for this command, the test above could not tell them apart."""
    early = simulate(packages["full_order"], 50, H, ["dcv.spool"], first_input_zero=False)["dcv.spool"]
    late = simulate(packages["full_order"], 50, H, ["dcv.spool"], first_input_zero=True)["dcv.spool"]
    assert np.max(np.abs(early - late)) > 1e-3 * np.ptp(early)


@pytest.mark.slow
def test_every_changed_parameter_matters(packages):
    signals, package, h = (
        SIGNALS["full_order"],
        packages["extended"],
        3 * H,
    )  # no fine step is needed for this

    def run(values=None):
        return simulate(package, STEPS // 3, h, signals, first_input_zero=False, values=values)

    whole = run()
    nominal = {name: dict(part.parameters) for name, part in read_parts(packages["full_order"])[0].items()}
    for component, parameters in CHANGED.items():
        for name in parameters:
            without = run({component: {name: nominal[component][name]}})
            change = max(np.max(np.abs(whole[s] - without[s])) / np.ptp(whole[s]) for s in signals)
            assert change > 1e-6, (
                f"{component}.{name} changes nothing, so no test tells whether it was honoured"
            )


def test_changed_parameters_are_in_the_fmus_and_honoured(engine, packages):
    signals = SIGNALS["full_order"]
    found, _ = run_engine(engine, packages["extended"], steps=STEPS, h=H, signals=signals, timeout=600)
    expected = simulate(packages["extended"], STEPS, H, signals, **SCHEMES[engine])
    worst = largest_difference(engine, found, expected, signals)
    assert max(worst.values()) < 1e-9, worst


def test_bindings_are_honoured_by_ecos_and_libcosim_and_ignored_by_the_others(engine, packages):
    signals = SIGNALS["full_order"]
    found, _ = run_engine(engine, packages["bound"], steps=STEPS, h=H, signals=signals, timeout=600)
    obeyed = "full_order" if engine in ("fmpy", "fmucontainer") else "extended"
    expected = simulate(packages[obeyed], STEPS, H, signals, **SCHEMES[engine])
    worst = largest_difference(engine, found, expected, signals)
    assert max(worst.values()) < 1e-9, worst


TWO_IN_ONE_PROCESS = """
import sys
from pathlib import Path
import numpy as np
from benchmarks.engines import ENGINES
engine, out, *packages = sys.argv[1:]
rows = [ENGINES[engine](Path(p), 200, 1e-3, ["mechanical.theta"])[0]["mechanical.theta"] for p in packages]
np.save(out, np.array(rows))
"""


def test_nominal_and_extended_model_do_not_mix_in_one_process(engine, packages, tmp_path):
    """The FMUs of both have the same names and model identifiers; pythonfmu shares Python modules by name."""
    order = [packages[name] for name in ("full_order", "extended", "full_order")]
    done = subprocess.run(
        [sys.executable, "-c", TWO_IN_ONE_PROCESS, engine, str(tmp_path / "out.npy"), *map(str, order)],
        env=environment(), capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    nominal, extended, again = np.load(tmp_path / "out.npy")
    np.testing.assert_array_equal(nominal, again)
    assert np.max(np.abs(nominal - extended)) > 0.05  # theta_0 alone is 0.1 rad


def test_ecos_ignores_parameter_sets_it_is_not_asked_for(packages, tmp_path):
    """Why the FMUs' own start values must already be those of the package."""
    if importlib.util.find_spec("ecospy") is None:
        pytest.skip("ecospy is not installed: pip install 'slew-cosim[clients]'")
    code = """
import sys
from benchmarks.engines import keep_loaded
keep_loaded()
from ecospy import EcosSimulation
simulation = EcosSimulation(1e-3, ssp_path=sys.argv[1])
simulation.init()
print(simulation.get_real("mechanical::theta_0"), simulation.get_real("mechanical::theta"))
simulation.terminate()
"""
    done = subprocess.run(
        [sys.executable, "-c", code, str(packages["bound"])],
        env=environment(), capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-2:] == ["0.0", "0.0"]
