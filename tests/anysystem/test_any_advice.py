"""What an answer on a system of FMUs says of numbers that may be further off than they are trusted."""

from types import SimpleNamespace

from cosim.anysystem.command import untrusted
from cosim.anysystem.options import AnyOptions

STRAINED = "what is trusted of Wall may be further off than that"


def test_numbers_that_leave_a_component_unexplained_may_be_fitted_freely() -> None:
    """The heat flow through a wall: three numbers off at once were "unexplained" without a word of what fits them."""
    group = SimpleNamespace(components=("Wall",))
    options = AnyOptions(trusted={"Wall.R_in": 0.3})
    for unexplained, calibrate, wanted in ((True, False, True), (True, True, False), (False, False, False)):
        finding = SimpleNamespace(unexplained=unexplained, model=SimpleNamespace(group=group))
        found = SimpleNamespace(findings={"Wall": finding})
        said = untrusted(found, options, calibrate)  # type: ignore[arg-type]
        assert any(STRAINED in text for text in said) == wanted
