"""The blocks of the drive: equations, physical effects, and the FMUs built from them."""
