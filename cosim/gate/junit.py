"""A check as JUnit XML, which CI servers show: a suite for each log, a case for each limit."""

from pathlib import Path

from lxml import etree

from cosim.files import write_bytes
from cosim.gate.found import Checked, GateResult


def write_junit(found: GateResult, path: Path) -> Path:
    """Write the file.

    Raises:
        OSError: it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    root = etree.Element("testsuites", name="cosim check", **_counts(found.checked))
    for item in found.checked:
        suite = etree.SubElement(root, "testsuite", name=_legal(item.log), **_counts([item]))
        _cases(suite, item)
    return write_bytes(path, etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True))


def _cases(suite: "etree._Element", item: Checked) -> None:
    if item.error is not None:
        case = etree.SubElement(suite, "testcase", classname=_legal(item.log), name="compare")
        etree.SubElement(case, "error", message=_legal(str(item.error)), type=type(item.error).__name__)
    each = item.seconds / max(len(item.limits), 1)
    for held in item.limits:
        case = etree.SubElement(
            suite, "testcase", classname=_legal(item.log), name=_legal(held.name), time=f"{each:.3f}"
        )
        if not held.kept:
            broken = etree.SubElement(case, "failure", message=_legal(held.line()), type="limit")
            broken.text = _legal("\n".join(item.lines()))


def _counts(checked: list[Checked]) -> dict[str, str]:
    return {
        "tests": str(sum(max(len(item.limits), item.error is not None) for item in checked)),
        "failures": str(sum(not held.kept for item in checked for held in item.limits)),
        "errors": str(sum(item.error is not None for item in checked)),
        "time": f"{sum(item.seconds for item in checked):.3f}",
    }


def _legal(text: str) -> str:
    """Without control characters, which XML 1.0 cannot hold."""
    return "".join(c if c in "\t\n" or (c >= " " and c not in "\ufffe\uffff") else "\ufffd" for c in text)
