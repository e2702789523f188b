"""Non-rigid registration: CPD, deformation fields, shape spaces and fits to partial clouds."""

from grasptransfer.registration.field import DeformationField, register_pair
from grasptransfer.registration.shape_space import ShapeSpace

__all__ = ["DeformationField", "ShapeSpace", "register_pair"]
