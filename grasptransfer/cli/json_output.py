"""Results as JSON on standard output, for other programs; what people read goes to standard error then."""

import json
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, arg

JsonFlag = FlagCreatePairsOff[
    Annotated[bool, arg(name="json", help="print the result as JSON on standard output.")]
]


def print_json(value: object, *, indent: int | None = 1) -> None:
    """Print plain values as JSON; without indent in one line."""
    print(json.dumps(value, indent=indent), flush=True)
