"""An identification as it is asked for."""

from pathlib import Path

from cosim.errors import UsageError
from cosim.identify.answer import Answer
from cosim.logs import Log, load_mapping
from cosim.ssp.hints import did_you_mean

KINDS = ("all", "dead_zone", "mechanics", "drive")


def run(what: str, log: Log, mapping: Path | None, settings: list[str]) -> Answer:
    """Take numbers from a log.

    Raises:
        UsageError: there is no such kind.
        DataError: the log lacks what it needs.
    """
    if what == "drive":
        from cosim.identify.run_drive import drive_answer

        return drive_answer([log], load_mapping(mapping) if mapping is not None else None, None, None)
    if what == "mechanics":
        from cosim.diagnosis.model.choice import machine_of
        from cosim.identify.run_mechanics import mechanics_answer

        return mechanics_answer(log, machine_of(None, log, mapping), settings, None)
    from cosim.identify.nominal import nominal

    if what == "all":
        from cosim.identify.run_design import all_answer

        return all_answer(log, nominal(settings), None)
    if what == "dead_zone":
        from cosim.identify.run import dead_zone_answer

        return dead_zone_answer(log, nominal(settings), None, None)
    raise UsageError(f"nothing called '{what}' is identified{did_you_mean(what, KINDS)}: {', '.join(KINDS)}")
