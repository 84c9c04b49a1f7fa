"""What the extended model rests on, for the packages that carry it: data, fitted values, gain, what is left, tools."""

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from cosim.diagnosis.answer.schema import Answer, Parameter
from cosim.files import whole
from cosim.ssp.traceability import embedding, meta_data

TOOLS = ("cosim", "python", "numpy", "scipy", "numba", "fmpy", "pythonfmu")


def sections(answer: Answer) -> dict[str, dict[str, str]]:
    """An answer as classifications of Simulation Resource Meta Data: section -> keyword -> text."""
    parameters = {
        f"{c.component or c.block}.{n}": (p, c.effect)
        for c in answer.causes
        for n, p in c.parameters.items()
    }  # fmt: skip
    fitted = {n: (p, "") for n, p in answer.nominal.items() if n not in parameters}
    left = {f"unexplained.{k}": f"{u.block}: {u.what}" for k, u in enumerate(answer.unexplained, 1)}
    refused = {f"refused.{k}": f"{r.effect}: {r.why}" for k, r in enumerate(answer.refused, 1)}
    data = {n: text for n, text in answer.made.items() if n not in TOOLS}
    data |= {"held_out": answer.held_out, "synthetic": str(answer.synthetic).lower()}
    if answer.span is not None:
        data["fitted_span"] = f"{answer.span[0]!r} {answer.span[1]!r} s"
    gain: dict[str, str] = {}
    for signal, found in answer.gain.items():
        gain |= {
            f"{signal}.rmse_before": f"{found.rmse_before!r} {found.unit}",
            f"{signal}.rmse_after": f"{found.rmse_after!r} {found.unit}",
            f"{signal}.noise_floor": f"{found.noise_floor!r} {found.unit}",
            f"{signal}.ci95_of_ratio": f"{found.ci95_of_ratio[0]!r} {found.ci95_of_ratio[1]!r}",
        }
    for signal, line in answer.linear.items():
        gain[f"{signal}.rmse_of_a_linear_model"] = f"{line.rmse!r} {line.unit}"
    result = {"verdict": answer.verdict, "model": answer.model}
    if answer.extended is not None and answer.extended.in_place:
        result["in_place_of_the_blocks"] = f"a linear model: {answer.extended.in_place}"
        fitted, parameters = {}, {}  # of the blocks, which are not in it
    result |= {f"cause.{k}": c.effect for k, c in enumerate(answer.causes, 1)}
    result |= {
        f"cause.{k}.indistinguishable_from": ", ".join(c.indistinguishable_from)
        for k, c in enumerate(answer.causes, 1)
        if c.indistinguishable_from
    }
    if answer.interrupted is not None:
        result["interrupted"] = answer.interrupted
    return {
        "diagnosis": result | left | refused,
        "data": data,
        "parameters": {k: t for n, (p, effect) in (fitted | parameters).items() for k, t in numbers(n, p, effect)},
        "held-out-gain": gain,
        "tools": {n: answer.made[n] for n in TOOLS if n in answer.made},
    }  # fmt: skip


def numbers(name: str, found: Parameter, effect: str) -> list[tuple[str, str]]:
    """Keywords and texts of one fitted value."""
    low, high = found.ci95
    listed = [(f"{name}.value", f"{found.value!r} {found.unit}"), (f"{name}.ci95", f"{low!r} {high!r}")]
    if found.next_log_ci95 is not None:
        low, high = found.next_log_ci95
        listed.append((f"{name}.next_log_ci95", f"{low!r} {high!r}"))
    return [*listed, (f"{name}.cause", effect)] if effect else listed


def credited(files: Mapping[Path, Path], answer: Answer) -> None:
    """Put packages where they are to lie, each with what its values rest on inside; other files as they are.

    All are written beside before the first one takes its name, so that a full disk leaves what was there.

    Args:
        files: as it was made -> where it is to lie.
        answer: what the values rest on.

    Raises:
        OSError: one cannot be written.
    """
    tool, told = f"slew-cosim {answer.made.get('cosim', '')}".strip(), sections(answer)
    with ExitStack() as stack:
        for made, target in files.items():
            package = made.suffix == ".ssp"
            content = embedding(made, meta_data(target.stem, tool, told)) if package else made.read_bytes()
            stack.enter_context(whole(target)).write_bytes(content)
