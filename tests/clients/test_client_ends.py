"""How a client's process ends: TBB's own race at the exit of ecos is kept out, a crash inside an FMU is reported."""

import importlib.util
import subprocess

import numpy as np
import pytest

from benchmarks.engines import run_engine, tbb_folder
from benchmarks.systems import parts
from tests.master import bad_fmus

pytestmark = [
    pytest.mark.clients,
    pytest.mark.skipif(parts.COMPILER is None, reason="no C compiler"),
    pytest.mark.skipif(
        importlib.util.find_spec("ecospy") is None,
        reason="ecospy is not installed: pip install 'slew-cosim[clients]'",
    ),
]
H, STEPS = 0.01, 100

# hwloc as slow as on a busy machine: libtcm's destructor, which calls it at the end of the process, takes its time
SLOW = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <unistd.h>
void hwloc_topology_destroy(void *topology) {
    void (*own)(void *) = (void (*)(void *))dlsym(RTLD_NEXT, "hwloc_topology_destroy");
    usleep(300000);
    own(topology);
}
"""


def package(mischief, folder):
    """Two components, so that ecos shares them out among threads; y of either is the time."""
    fmus = dict.fromkeys(("first", "second"), bad_fmus.build(mischief, folder))
    wires = [("first.y", "second.u"), ("second.y", "first.u")]
    return parts.write_ssp(folder / "two.ssp", fmus, wires, {"first": {}, "second": {}}, [])


def run(file):
    return run_engine("ecos", file, steps=STEPS, h=H, signals=["first.y", "second.y"], timeout=600)[0]


@pytest.mark.skipif(
    not (tbb_folder() / "libtcm.so.1").is_file(), reason="this TBB loads no library beside itself"
)
def test_ecos_ends_well_however_late_its_threads_end(tmp_path, monkeypatch):
    slow = tmp_path / "slow.so"
    source = tmp_path / "slow.c"
    source.write_text(SLOW)
    subprocess.run([parts.COMPILER, "-shared", "-fPIC", "-o", str(slow), str(source), "-ldl"], check=True)
    monkeypatch.setenv("LD_PRELOAD", str(slow))
    found = run(package("NONE", tmp_path))
    np.testing.assert_allclose(found["second.y"], H * np.arange(STEPS + 1), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("mischief", "code"), [("SEGV", -11), ("ABORT", -6), ("AT_END", 0)])
def test_a_crash_inside_an_fmu_is_reported(mischief, code, tmp_path):
    with pytest.raises(RuntimeError, match=f"ecos ended with {code}:"):
        run(package(mischief, tmp_path))
