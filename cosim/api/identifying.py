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
        return _dynamics(what, log, settings, block, between, mapping)
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
    if what == "all":
        from cosim.api.other import other_of
        from cosim.identify.other_machine import known_beside
        from cosim.identify.run_design import all_answer

        other = other_of(mapping, [log])
        return all_answer(log, known_beside(settings, other), None, other)
    if what == "dead_zone":
        return dead_zone_of([log], mapping, settings)
    raise UsageError(f"nothing called '{what}' is identified{did_you_mean(what, KINDS)}: {', '.join(KINDS)}")


def dead_zone_of(
    logs: list[Log],
    mapping: Path | None,
    settings: list[str],
    response: str | None = None,
    cutoff: float | None = None,
) -> Answer:
    """The dead zone of the crane's valve, or of a machine that a mapping describes.

    Of a machine it is what its static curve has, unless its spool was measured, or another response is asked for.

    Raises:
        UsageError: the response is none, or several logs are given of the crane.
        DataError, ModelError: logs, mapping or model are bad.
    """
    from cosim.api.other import other_of
    from cosim.identify.dead_zone import RESPONSES
    from cosim.identify.other_machine import known_beside
    from cosim.identify.run import dead_zone_answer
    from cosim.identify.run_drive import still_answer

    other = other_of(mapping, logs)
    if other is not None and response is None:
        seen = ("spool", other.motion, "p_load") if other.command == "u" else (other.motion,)
        response = next((name for name in seen if name in logs[0]), other.motion)
    if other is not None and mapping is not None and response == other.motion:
        return still_answer(logs, load_mapping(mapping), response, other.following(logs[0]))
    if response is not None and response not in RESPONSES:
        raise UsageError(f"--response '{response}': choose {', '.join(RESPONSES)}")
    if len(logs) > 1:
        raise UsageError("the dead zone of the valve is taken from one log: name one, best of a slow ramp")
    return dead_zone_answer(logs[0], known_beside(settings, other), response, cutoff, other)


def _dynamics(
    what: str,
    log: Log,
    settings: list[str],
    block: str | None,
    between: tuple[str, str] | None,
    mapping: Path | None,
) -> Answer:
    from cosim.api.other import other_of
    from cosim.identify.other_machine import known_beside
    from cosim.identify.run import channel, channel_of, transfer_function_answer
    from cosim.identify.run_frf import FrfRequest, frf_answer

    source, target = between or (None, None)
    other = other_of(mapping, [log])
    if other is not None and block is None and between is None:
        chosen = channel_of(other, log)
    else:
        chosen = channel(block, source, target)
    known = known_beside(settings, other)
    if what == "frf":
        return frf_answer([log], chosen, known, FrfRequest(method="welch"), other)
    return transfer_function_answer([log], chosen, (), known, other)
