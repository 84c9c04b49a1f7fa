"""Linearised gains of the physical hydraulics: against the block's own steps, and the poles of (5.12)."""

import json

import numpy as np
import pytest

from cosim import hydraulics
from cosim.paths import ssp_folder
from cosim.ssp.read import read_system
from cosim.ssp.write import write_ssp
from fmus.build import composed_block


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    file = tmp_path_factory.mktemp("physical") / "physical_open.ssp"
    return write_ssp(ssp_folder() / "physical.ssd", file, open=True)


@pytest.fixture(scope="module")
def system(package):
    found = read_system(package)
    yield found
    found.close()


def test_poles_are_those_of_the_identified_chain(system):
    """9.09 and 34.9 rad/s (SYSTEM 9.1), which (5.9) has as w_mh = 17.8 rad/s and zeta_mh = 1.25."""
    p = np.sort(hydraulics.poles(system).real)
    assert p == pytest.approx([-34.9, -1.0 / 0.11], rel=1e-6)
    assert np.sqrt(p[0] * p[1]) == pytest.approx(17.8, abs=0.02)
    found = hydraulics.linearised(system)
    # leakage adds 0.02 to the damping and stiffens the pair by a few per cent: our volumes keep the poles, not (5.9) itself
    assert found["w_mh"] == pytest.approx(17.8, rel=0.06)
    assert found["zeta_mh"] == pytest.approx(1.25, rel=0.05)
    assert found["zeta_mh_friction"] < found["zeta_mh"]
    # 2.27 deg/s at full command (SYSTEM section 7)
    assert np.degrees(found["gain"] * 2.375e-3) == pytest.approx(2.27, rel=2e-3)


def load_flow(composed, p, spool, p_load):
    """Q_L [m3/s] that the block's orifices pass, from the rates of its pressures over a tiny step with the column still."""
    module = composed.module
    h = 1e-9
    c = module.coefficients(p, h)
    x = module.start(module.Input(spool, 0.0), p._replace(p_load_0=p_load))
    x1, _ = module.advance(
        x, module.begin(x, module.Input(spool, 0.0), p, []), module.Input(spool, 0.0), p, c
    )
    rate = (x1.p_a - x1.p_b - (x.p_a - x.p_b)) / h
    volume = 0.5 * (2.0 * p.V_L + p.V_A + p.V_B)
    return rate * volume / (2.0 * p.beta) + p.C_L * (x.p_a - x.p_b)


def test_gains_are_the_slopes_of_the_block_s_flow(system):
    composed = composed_block("continuity_physical", "continuity")
    p = composed.module.Parameters(*(v.start for v in composed.parameters.values()))
    found = hydraulics.linearised(system)
    at, step = found["opening"], 2e5
    flow = load_flow(composed, p, at, 0.0)
    assert flow == pytest.approx(found["K_flow"] * at, rel=1e-5)
    slope = (load_flow(composed, p, at, step) - load_flow(composed, p, at, -step)) / (2.0 * step)
    assert -slope == pytest.approx(found["K_pressure"], rel=1e-3)
    assert found["Q_max"] == pytest.approx(load_flow(composed, p, 2.375e-3, 0.0), rel=1e-5)


def test_info_prints_them(package, capsys):
    from cosim.cli import main

    with pytest.raises(SystemExit) as end:
        main(["info", str(package), "--json"])
    assert end.value.code == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["hydraulics"]) >= {"K_flow", "K_pressure", "Q_max", "w_mh", "zeta_mh"}
    assert "l/min per bar" in found["flow_gains"]
    assert "(5.7), (5.8)" in found["pressure_and_motion"]
