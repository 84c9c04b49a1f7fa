"""Looks at an FMU's library without loading it: is it one, for the platform it says, whole, and does it export FMI?

Sources: System V ABI, "ELF-64 Object File Format"; Microsoft, "PE Format"; Apple, "Mach-O File Format Reference".
"""

import struct

FUNCTIONS = (
    "fmi2Instantiate",
    "fmi2FreeInstance",
    "fmi2SetupExperiment",
    "fmi2EnterInitializationMode",
    "fmi2ExitInitializationMode",
    "fmi2Terminate",
    "fmi2Reset",
    "fmi2GetReal",
    "fmi2SetReal",
    "fmi2DoStep",
    "fmi2GetTypesPlatform",
    "fmi2GetVersion",
    "fmi2SetDebugLogging",
    "fmi2GetInteger",
    "fmi2GetBoolean",
    "fmi2GetString",
    "fmi2SetInteger",
    "fmi2SetBoolean",
    "fmi2SetString",
)
"""Of what FMI 2.0, section 4.2.3, has every co-simulation slave export, what a run calls."""

STATE = (
    "fmi2GetFMUstate",
    "fmi2SetFMUstate",
    "fmi2FreeFMUstate",
)
CAPABILITIES = (
    *STATE,
    "fmi2SerializedFMUstateSize",
    "fmi2SerializeFMUstate",
    "fmi2DeSerializeFMUstate",
    "fmi2GetDirectionalDerivative",
    "fmi2SetRealInputDerivatives",
    "fmi2GetRealOutputDerivatives",
    "fmi2CancelStep",
    "fmi2GetStatus",
    "fmi2GetRealStatus",
    "fmi2GetIntegerStatus",
    "fmi2GetBooleanStatus",
    "fmi2GetStringStatus",
)
"""The others, each for what an FMU of FMI 2.0 may declare that it can; hand-written ones leave out what they cannot."""

_TYPES = (
    "Float64", "Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean", "String",
)  # fmt: skip
FUNCTIONS3 = (
    "fmi3InstantiateCoSimulation",
    "fmi3FreeInstance",
    "fmi3EnterInitializationMode",
    "fmi3ExitInitializationMode",
    "fmi3DoStep",
    "fmi3GetVersion",
    "fmi3SetDebugLogging",
    "fmi3Terminate",
    "fmi3Reset",
    *(f"fmi3{way}{name}" for way in ("Get", "Set") for name in _TYPES),
    "fmi3GetFMUState",
    "fmi3SetFMUState",
    "fmi3FreeFMUState",
    "fmi3SerializedFMUStateSize",
    "fmi3SerializeFMUState",
    "fmi3DeserializeFMUState",
)
"""Of what FMI 3.0, section 2.1.1, has every FMU for co-simulation export, what this project and most hosts call."""

_NARROW = ("x86", "aarch32", "riscv32")  # architectures of 32 bit in the names of FMI 3.0

SUFFIXES = {"linux": ".so", "win": ".dll", "darwin": ".dylib"}
_ELF_MACHINES = {3: "32", 62: "64", 183: "64"}  # i386, x86-64, AArch64
_PE_MACHINES = {0x14C: "32", 0x8664: "64", 0xAA64: "64"}
_ARCHITECTURES = {62: "x86_64", 183: "aarch64", 0x8664: "x86_64", 0xAA64: "aarch64"}


def platform_of(folder: str) -> str:
    """The name that FMI 2.0 has for a folder of libraries: that of FMI 3.0 says the architecture first, as x86_64-linux."""
    machine, _, system = folder.partition("-")
    if not system:
        return folder
    return {"windows": "win"}.get(system, system) + ("32" if machine in _NARROW else "64")


def architecture_of(folder: str) -> str | None:
    """The architecture that a folder of FMI 3.0 names; those of FMI 2.0 name a system and a width only."""
    machine, _, system = folder.partition("-")
    return machine if system else None


def problem(data: bytes, folder: str, version: str = "2.0", architecture: str | None = None) -> str | None:
    """What is wrong with a library, or None.

    Args:
        data: the file.
        folder: the one that it lies in, such as linux64 (FMI 2.0) or x86_64-linux (FMI 3.0).
        version: of FMI.
        architecture: which it must be for, as FMI 3.0 calls it; by default what the folder says.
    """
    platform = platform_of(folder)
    architecture = architecture or architecture_of(folder)
    if not data:
        return "is empty"
    check = {"linux": _elf, "win": _pe, "darwin": _mach}.get(platform.rstrip("0123456789"))
    if check is None:
        return None  # a platform that FMI does not name
    try:
        wrong = check(data, platform, architecture)
    except struct.error:
        wrong = "is cut off"
    if wrong:
        return wrong
    functions = FUNCTIONS if version == "2.0" else FUNCTIONS3
    missing = [name for name in functions if name.encode() + b"\0" not in data]
    if len(missing) > 3:
        missing[3:] = [f"nor {len(missing) - 3} more functions of FMI {version}"]
    return f"exports no {', '.join(missing)}" if missing else None


def absent(data: bytes, version: str = "2.0") -> tuple[str, ...]:
    """Functions that FMI 2.0 demands of a library, which it does not export and a run can do without."""
    return tuple(n for n in CAPABILITIES if version == "2.0" and n.encode() + b"\0" not in data)


def _other(machine: int, architecture: str | None) -> bool:
    """True if a machine's number is known to be of another architecture."""
    return architecture in _ARCHITECTURES.values() and _ARCHITECTURES.get(machine) != architecture


def _elf(data: bytes, platform: str, architecture: str | None) -> str | None:
    if data[:4] != b"\x7fELF":
        return "is no ELF library"
    wide = data[4] == 2
    if data[5] != 1:
        return "is no little-endian library"
    kind, machine = struct.unpack_from("<HH", data, 16)
    if _ELF_MACHINES.get(machine) != platform[-2:] or _other(machine, architecture):
        return f"is for another machine (ELF machine {machine})"
    if kind != 3:
        return "is no shared library"
    programs, sections = struct.unpack_from("<QQ" if wide else "<II", data, 32 if wide else 28)
    size, count, section_size, section_count = struct.unpack_from("<HHHH", data, 54 if wide else 42)
    if programs + size * count > len(data) or sections + section_size * section_count > len(data):
        return "is cut off"
    for k in range(count):
        # offset and size in the file of what is to be loaded
        at = programs + k * size
        begin, length = (
            (struct.unpack_from("<Q", data, at + 8)[0], struct.unpack_from("<Q", data, at + 32)[0])
            if wide
            else (struct.unpack_from("<I", data, at + 4)[0], struct.unpack_from("<I", data, at + 16)[0])
        )
        if begin + length > len(data):
            return "is cut off"
    return None


def _pe(data: bytes, platform: str, architecture: str | None) -> str | None:
    if data[:2] != b"MZ":
        return "is no Windows library"
    (start,) = struct.unpack_from("<I", data, 60)
    if data[start : start + 4] != b"PE\0\0":
        return "is no Windows library"
    machine, count = struct.unpack_from("<HH", data, start + 4)
    optional, flags = struct.unpack_from("<HH", data, start + 20)
    if _PE_MACHINES.get(machine) != platform[-2:] or _other(machine, architecture):
        return f"is for another machine (PE machine {machine:#x})"
    if not flags & 0x2000:
        return "is no shared library"
    for k in range(count):
        length, begin = struct.unpack_from("<II", data, start + 24 + optional + 40 * k + 16)
        if begin + length > len(data):
            return "is cut off"
    return None


def _mach(data: bytes, platform: str, architecture: str | None) -> str | None:
    if data[:4] not in (b"\xcf\xfa\xed\xfe", b"\xce\xfa\xed\xfe", b"\xca\xfe\xba\xbe"):
        return "is no Mach-O library"
    return None
