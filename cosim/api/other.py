"""Of which machine a log's numbers are: the crane's, or another's that its mapping describes."""

from pathlib import Path

from cosim.errors import ModelError
from cosim.identify.other_machine import OURS, Other
from cosim.identify.run_drive import ends
from cosim.logs import Log, load_mapping


def other_of(mapping: Path | None, logs: list[Log]) -> Other | None:
    """The machine of logs whose mapping describes one; None for the crane.

    Raises:
        DataError, UsageError, ModelError: mapping or model is bad.
    """
    from cosim.diagnosis.model.choice import machine_of

    if mapping is None:
        return None
    plain = load_mapping(mapping)
    model = logs[0].model or OURS[1]
    if not plain.machine and model in OURS:
        return None
    name, (command, motion) = plain.name or Path(model).stem, ends(plain)
    beside = [signal for signal in logs[0].signals if signal != command]
    if motion not in logs[0] and len(beside) == 1:
        (motion,) = beside
    unknown = Other(name, mapping, command=command, motion=motion)  # FMUs of which we know nothing
    if model.lower().endswith(".fmu"):
        return unknown
    try:
        machine = machine_of(None, logs, mapping)
    except ModelError:
        if plain.machine or model.lower().endswith(".ssd"):
            raise
        return unknown
    if machine.name in OURS:
        return None
    return Other(
        machine.name,
        mapping,
        tuple(machine.wiring.blocks),
        {**machine.wiring.values, **machine.values},
        command,
        next((n for n in (motion, *machine.groups[-1].observed) if n in logs[0]), motion),
        machine.lexicon,
    )
