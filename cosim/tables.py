"""Tables of a mapping file checked against their declaration, wrong keys told with the closest right one."""

from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from cosim.errors import DataError
from fmus import registry

Table = TypeVar("Table", bound=BaseModel)


def checked(declared: type[Table], content: dict[str, Any], table: str, of: str, source: object) -> Table:
    """A table, checked.

    Args:
        declared: the model of the table.
        content: the table as read.
        table: its name in the file.
        of: what has such keys, for messages.
        source: the file, for messages.

    Raises:
        DataError: a key or value is wrong; the message names it.
    """
    try:
        return declared.model_validate(content)
    except ValidationError as error:
        found = []
        for item in error.errors():
            key = ".".join([table, *(str(part) for part in item["loc"])])
            if item["type"] == "extra_forbidden":
                hint = registry.suggestion(str(item["loc"][-1]), list(declared.model_fields))
                found.append(f"'{key}' is not a key of {of}; {hint}")
            else:
                found.append(f"'{key}': {str(item['msg']).removeprefix('Value error, ')}")
        raise DataError(f"{source}: {'; '.join(found)}") from None
