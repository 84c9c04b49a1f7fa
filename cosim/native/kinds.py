"""Kinds of values in translated equations, and the C text of an expression with its kind."""

from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True)
class Kind:
    """A kind of value.

    Attributes:
        c: its C type.
        text: what people call it.
    """

    c: str
    text: str


@dataclass(frozen=True)
class Struct(Kind):
    """A named or plain tuple: a C struct; plain tuples have the fields e0, e1, ..."""

    fields: tuple[tuple[str, Kind], ...] = ()

    @property
    def names(self) -> list[str]:
        """Names of the fields."""
        return [name for name, _ in self.fields]

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """Kinds of the fields."""
        return tuple(kind for _, kind in self.fields)

    def definition(self) -> str:
        """The C definition; an empty struct is no C99, so it gets a field that nobody uses."""
        lines = [f"    {kind.c} {c_name(name)};" for name, kind in self.fields] or ["    int nothing;"]
        return "\n".join(["typedef struct {", *lines, f"}} {self.c};"])


REAL = Kind("double", "a number")
WHOLE = Kind("int64_t", "a whole number")
TRUTH = Kind("int", "a truth value")
ARRAY = Kind("py_array", "a list of numbers")
ARRAYS = Kind("const py_array *", "the list of lists")
NONE = Kind("void", "nothing")
NUMBERS = (TRUTH, WHOLE, REAL)  # from the narrow to the wide

# how tightly a C expression binds
ATOM, UNARY, PRODUCT, SUM, ORDER, EQUALITY, AND, OR, CHOICE = 9, 8, 7, 6, 5, 4, 3, 2, 1


class Value(NamedTuple):
    """C text of an expression.

    Attributes:
        code: the text.
        kind: what it gives.
        rank: how tightly it binds.
        constant: the number, if it is written as one.
        pointer: the text is a pointer to the struct, not the struct.
    """

    code: str
    kind: Kind
    rank: int = ATOM
    constant: float | int | None = None
    pointer: bool = False

    def at(self, rank: int) -> str:
        """The text, in parentheses if it binds less tightly than `rank`."""
        return self.code if self.rank >= rank else f"({self.code})"

    def real(self) -> "Value":
        """As a double."""
        if self.kind is REAL:
            return self
        if self.constant is not None:
            return Value(real_text(float(self.constant)), REAL, constant=float(self.constant))
        return Value(f"(double)({self.code})", REAL, UNARY)

    def whole(self) -> "Value":
        """As an int64_t; only truth values and whole numbers can be."""
        return Value(f"(int64_t){self.at(UNARY)}", WHOLE, UNARY) if self.kind is TRUTH else self

    def as_kind(self, kind: Kind) -> "Value":
        """As a wider kind."""
        if kind is REAL:
            return self.real()
        return self.whole() if kind is WHOLE else self


def real_text(value: float) -> str:
    """A C literal of the same double."""
    if value != value:
        return "NAN"
    if abs(value) == float("inf"):
        return "HUGE_VAL" if value > 0.0 else "-HUGE_VAL"
    return repr(value)


def joined(one: Kind | None, other: Kind) -> Kind | None:
    """The kind that holds both, as Python would hand either on; None if there is none."""
    if one is None or one == other:
        return other
    if one in NUMBERS and other in NUMBERS:
        return max(one, other, key=NUMBERS.index)
    return None


# of C and C++, and what the headers define
KEYWORDS = frozenset((
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum",
    "extern", "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return",
    "short", "signed", "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void",
    "volatile", "while", "alignas", "alignof", "and", "and_eq", "bitand", "bitor", "bool", "catch", "char8_t",
    "char16_t", "char32_t", "class", "co_await", "co_return", "co_yield", "compl", "concept", "const_cast",
    "consteval", "constexpr", "constinit", "decltype", "delete", "dynamic_cast", "explicit", "export", "false",
    "friend", "mutable", "namespace", "new", "noexcept", "not", "not_eq", "nullptr", "operator", "or", "or_eq",
    "private", "protected", "public", "reinterpret_cast", "requires", "static_assert", "static_cast", "template",
    "this", "thread_local", "throw", "true", "try", "typeid", "typename", "using", "virtual", "wchar_t", "xor",
    "xor_eq", "asm", "typeof", "NAN", "NULL", "INFINITY", "HUGE_VAL", "I", "EOF", "int64_t",
    "isnan", "isinf", "isfinite", "fabs", "tanh", "atan", "atan2", "copysign", "asinh", "erf", "erfc",
    "linux", "unix",
))  # fmt: skip


def c_name(name: str) -> str:
    """The name in C: as it is, unless C or our helpers use it, or it has letters beyond ASCII."""
    if name in KEYWORDS or name.startswith(("py_", "_")):
        return f"own_{name}"
    return "".join(c if c.isascii() else f"_u{ord(c):04x}" for c in name)
