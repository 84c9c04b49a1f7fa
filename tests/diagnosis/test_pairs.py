"""Two causes at once, one of which is hard to tell from a third."""

from dataclasses import replace

import pytest
from hidden_logs import diagnosed

from cosim.diagnosis.fitting.trials import tried
from cosim.diagnosis.hypotheses.naming import beside_rivals
from fmus import registry


@pytest.mark.slow
def test_which_of_two_close_effects_it_is_may_show_once_the_other_cause_is_known() -> None:
    hidden = ("mechanical.coulomb_friction", "mechanical.inertia")
    finding = diagnosed(*hidden, seed=27, seconds=40.0).findings["mechanical"]
    task, known = finding.task, registry.effects()
    names = ("continuity.cracking_pressure", "mechanical.coulomb_friction", "mechanical.inertia")
    opens, dry, heavy = (known[n] for n in names)
    one = tried(task, (opens,), 0.01, finding.null.fit)
    # as if the log alone could hardly tell the two apart
    other = tried(task, (dry,), 0.01, finding.null.fit)
    close = replace(other, fit=replace(other.fit, log_likelihood=one.fit.log_likelihood - 1.0))
    best, *_ = beside_rivals(task, one, [one, close], (opens, dry, heavy), 0.01)
    assert set(best.effects) == {dry, heavy}
    far = replace(other, fit=replace(other.fit, log_likelihood=one.fit.log_likelihood - 50.0))
    assert beside_rivals(task, one, [one, far], (opens, dry, heavy), 0.01) == []
