"""Two results of one category side by side."""

from grasptransfer.errors import CategoryError
from grasptransfer.registration import register_pair as pair_fields
from grasptransfer.registration.field import FieldPair
from grasptransfer.result import TransferResult


def register_pair(a: TransferResult, b: TransferResult) -> FieldPair:
    """The field from instance A to instance B, through their canonical model.

    Raises:
        CategoryError: the results are of different categories.
    """
    if a.category.canonical_sha256 != b.category.canonical_sha256:
        raise CategoryError(
            "the results are of different categories", value=(a.category.name, b.category.name)
        )
    return pair_fields(a.field, b.field)
