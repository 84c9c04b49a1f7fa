"""Checksums of the columns in a Parquet file that we write: page checksums leave out the file's own description.

They stand in the schema's metadata, column name -> CRC-32 of its float64 values, little-endian, NaN as one pattern.
"""

import json
import zlib

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

KEY = b"cosim_crc32"


def of(column: NDArray[np.float64]) -> int:
    """CRC-32 of a column (n,)."""
    values = np.ascontiguousarray(column, dtype="<f8")
    missing = np.isnan(values)
    if missing.any():
        values = np.where(missing, np.nan, values)
    return zlib.crc32(values.view(np.uint8).data)


def added(table: pa.Table) -> pa.Table:
    """The table of float64 columns with their checksums in its metadata."""
    sums = {name: of(table.column(name).to_numpy()) for name in table.column_names}
    return table.replace_schema_metadata({**(table.schema.metadata or {}), KEY: json.dumps(sums)})


def read(schema: pa.Schema) -> dict[str, int] | None:
    """The checksums in a schema's metadata, None where there are none.

    Raises:
        ValueError: they are damaged.
    """
    text = (schema.metadata or {}).get(KEY)
    if text is None:
        return None
    found = json.loads(text)
    if not isinstance(found, dict):
        raise ValueError("its checksums are damaged")
    return found
