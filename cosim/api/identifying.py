"""An identification as it is asked for."""

from pathlib import Path

from cosim.errors import UsageError
from cosim.identify.answer import Answer
from cosim.logs import Log, load_mapping
from cosim.ssp.hints import did_you_mean

KINDS = ("all", "dead_zone", "mechanics", "drive", "frf", "transfer_function")
DYNAMIC = ("frf", "transfer_function")  # which go from one signal to another


def run(
    what: str,
    log: Log,
    mapping: Path | None,
    settings: list[str],
    block: str | None = None,
    between: tuple[str, str] | None = None,
) -> Answer:
    """Take numbers from a log.

    Raises:
        UsageError: there is no such kind, or it does not go between two signals.
        DataError: the log lacks what it needs.
    """
    if what in DYNAMIC:
        return _dynamics(what, log, settings, block, between)
    if block is not None or between is not None:
        raise UsageError(
            f"'{what}' is of the drive as it is: block and between go with {' and '.join(DYNAMIC)}"
        )
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


def _dynamics(
    what: str, log: Log, settings: list[str], block: str | None, between: tuple[str, str] | None
) -> Answer:
    from cosim.identify.nominal import nominal
    from cosim.identify.run import channel, transfer_function_answer
    from cosim.identify.run_frf import FrfRequest, frf_answer

    source, target = between or (None, None)
    chosen, known = channel(block, source, target), nominal(settings)
    if what == "frf":
        return frf_answer([log], chosen, known, FrfRequest(method="welch"))
    return transfer_function_answer([log], chosen, (), known)
