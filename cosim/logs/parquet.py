"""Parquet files, read batch by batch into float64 columns."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cosim.errors import DataError
from cosim.logs import checksums
from cosim.logs.source import Array, Source, parse_label, translated

_BATCH = 1 << 17
_DAMAGED = "the file is damaged, copy or write it again"


class ParquetSource(Source):
    """A Parquet file; a column's unit is in its name, or in the field's metadata under ``unit``.

    Raises:
        DataError: the file is damaged, empty, or two columns have the same name.
    """

    def __init__(self, path: Path) -> None:
        with translated(path, "Parquet"), pq.ParquetFile(path) as file:
            schema, self._rows = file.schema_arrow, file.metadata.num_rows
            self._sums = checksums.read(schema)
        double = sorted({name for name in schema.names if schema.names.count(name) > 1})
        if double:
            raise DataError(f"{path}: more than one column is named '{double[0]}': rename one")
        if not self._rows:
            raise DataError(f"{path}: there is no data row")
        units = [(field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace") for field in schema]
        super().__init__(path, [parse_label(f.name, unit) for f, unit in zip(schema, units, strict=True)])
        self._schema = schema
        if self._sums is not None and sorted(self._sums) != sorted(schema.names):
            raise DataError(f"{path}: its columns are not those of its checksums: {_DAMAGED}")

    def read(self, indices: Sequence[int]) -> list[Array]:
        """See `Source.read`."""
        names = [self._schema.names[k] for k in indices]
        for name in names:
            self._check_type(name)
        with (
            translated(self.path, "Parquet"),
            pq.ParquetFile(self.path, page_checksum_verification=True) as file,
        ):
            # one column at a time: the decoder's buffers then stay small beside the result
            return [self._column(file, name) for name in names]

    def _column(self, file: pq.ParquetFile, name: str) -> Array:
        column = np.empty(self._rows)
        filled = 0
        for batch in file.iter_batches(batch_size=_BATCH, columns=[name], use_threads=False):
            values = batch.column(0).cast(pa.float64()).to_numpy(zero_copy_only=False)
            column[filled : filled + len(values)] = values
            filled += len(values)
        if filled != self._rows:
            raise DataError(f"{self.path}: column '{name}' has {filled} of the {self._rows} rows announced")
        if self._sums is not None and checksums.of(column) != self._sums[name]:
            raise DataError(f"{self.path}: column '{name}' is not that of its checksum: {_DAMAGED}")
        return column

    def _check_type(self, name: str) -> None:
        kind = self._schema.field(name).type
        numeric = (
            pa.types.is_integer,
            pa.types.is_floating,
            pa.types.is_boolean,
            pa.types.is_decimal,
            pa.types.is_null,
        )
        if not any(test(kind) for test in numeric):
            raise DataError(f"{self.path}: column '{name}' is of type {kind}, not numbers")
