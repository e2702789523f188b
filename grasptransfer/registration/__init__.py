"""Non-rigid registration: CPD, deformation fields, shape spaces and fits to partial clouds."""

from grasptransfer.registration.cpd import cpd, cpd_all
from grasptransfer.registration.cpd_input import PreparedSource
from grasptransfer.registration.cpd_result import CpdProgress, CpdResult, CpdStatus
from grasptransfer.registration.field import DeformationField, FieldPair, register_pair
from grasptransfer.registration.shape_space import LatentPosterior, ShapeSpace, SpaceScore

__all__ = [
    "CpdProgress",
    "CpdResult",
    "CpdStatus",
    "DeformationField",
    "FieldPair",
    "LatentPosterior",
    "PreparedSource",
    "ShapeSpace",
    "SpaceScore",
    "cpd",
    "cpd_all",
    "register_pair",
]
