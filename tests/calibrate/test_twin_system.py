"""The twin of a whole system gives the numbers of its FMUs, and only systems that have one get one."""

import numpy as np
import pytest

from cosim.calibrate.twin import Twin
from cosim.compare import Comparator
from cosim.errors import UsageError


@pytest.mark.parametrize("model", ["full_order", "simplified"])
def test_the_twin_is_the_fmus(friction, packages, model):
    inertia = {"mechanical.J": 800.0} if model == "full_order" else {"simplified.k": 0.18}
    with Comparator(friction, packages[model]) as comparator:
        twin = Twin(comparator)
        for values in (
            {},
            inertia,
            {**inertia, "sensor.bias": 0.01},
            {},
        ):  # what is kept must not be what is stale
            ours, fmus = twin.simulate(values), comparator.simulate(values)
            assert ours.keys() == fmus.keys()
            for name, signal in fmus.items():
                np.testing.assert_allclose(
                    ours[name], signal, rtol=0.0, atol=1e-12 * np.abs(signal).max(), err_msg=name
                )


def test_an_effect_runs_in_the_twin_as_well(friction, packages):
    values = {"mechanical.tau_c": 150.0, "dcv.tau_d": 0.0123, "continuity.k_s": 1e9, "mechanical.gap": 0.002}
    with Comparator(friction, packages["full_order"]) as comparator:
        ours, fmus = Twin(comparator).simulate(values), comparator.simulate(values)
        for name, signal in fmus.items():
            np.testing.assert_allclose(
                ours[name], signal, rtol=0.0, atol=1e-9 * np.abs(signal).max(), err_msg=name
            )


def test_a_system_with_a_loop_has_none(friction, packages):
    with Comparator(friction, packages["physical"]) as comparator, pytest.raises(LookupError, match="loop"):
        Twin(comparator)


def test_an_unknown_name_is_refused_by_the_twin_too(friction, packages):
    with (
        Comparator(friction, packages["full_order"]) as comparator,
        pytest.raises(UsageError, match=r"mechanical\.J"),
    ):
        Twin(comparator).simulate({"mechanical.Jay": 1.0})
