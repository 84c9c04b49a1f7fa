"""The documentation page of a native FMU: that of its block, or of each block of a chain, and how to compile it."""

from lxml import etree, html
from lxml.builder import E

from cosim.native.model import Model
from fmus.describe import documentation

COMPILE = (
    "No Python is needed. To compile for another platform, in the folder sources: "
    "cc -std=c99 -O2 -ffp-contract=off -fPIC -shared -fvisibility=hidden fmu.c -lm -o {name}.so "
    "(put it into binaries/, in the folder that FMI {fmi} names for that platform)."
)
# where each version of FMI has the picture
ICON = {"2.0": "model.png", "3.0": "terminalsAndIcons/icon.png"}


def page(model: Model, fmi: str = "2.0") -> bytes:
    """The page as HTML, in an FMU of the version `fmi`."""
    pages = [html.fromstring(documentation(p.composed, p.starts)) for p in model.parts]
    body = pages[0].find("body")
    body.find("img").set("src", f"../{ICON[fmi]}")
    if len(pages) > 1:
        body = E.body(
            E.h1(model.title), E.p(f"Parameters are named component.parameter. Inside: {order(model)}.")
        )
        for part, other in zip(model.parts, pages, strict=True):
            body.append(E.h1(part.name))
            # the first heading is the block's title, the second entry its picture
            body.append(E.p(part.composed.block.title))
            body.extend(other.find("body")[2:])
        body.append(E.h1("Outputs"))
        rows = [E.tr(E.th("output"), E.th("of"))]
        rows += [E.tr(E.td(n), E.td(".".join(model.places[n]))) for n, _ in model.of("output")]
        body.append(E.table(*rows, border="1"))
    body.append(E.h2("Sources"))
    body.append(E.p(COMPILE.format(name=model.name, fmi=fmi)))
    whole = E.html(E.head(E.meta(charset="utf-8"), E.title(model.title)), body)
    text: bytes = etree.tostring(
        whole, method="html", encoding="utf-8", doctype="<!DOCTYPE html>", pretty_print=True
    )
    return text


def order(model: Model) -> str:
    """The components in the order of stepping."""
    return ", ".join(p.name for p in model.parts)
