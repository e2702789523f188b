"""A category of objects on disk: its canonical model, instances, shape space and grasp file.

`objects/README.md` is the format. Building one from meshes is `workshop.building`.
"""

from grasptransfer.category.category import (
    Category,
    list_categories,
    load_category,
    objects_folder,
)
from grasptransfer.category.settings import DENSITY, CategoryFile, Settings

__all__ = [
    "DENSITY",
    "Category",
    "CategoryFile",
    "Settings",
    "list_categories",
    "load_category",
    "objects_folder",
]
