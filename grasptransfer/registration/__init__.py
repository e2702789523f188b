"""Point clouds in, smooth fields out: CPD, deformation fields, shape spaces, and their fit to partial clouds.

NumPy and SciPy alone: no network, no picture, no category. `docs/registration.md` shows it in use.
"""

from grasptransfer.registration.cpd import cpd, cpd_all
from grasptransfer.registration.cpd_input import PreparedSource
from grasptransfer.registration.cpd_result import CpdProgress, CpdResult, CpdStatus
from grasptransfer.registration.displacement_model import DisplacementModel, motion_along
from grasptransfer.registration.field import DeformationField, FieldPair, register_pair
from grasptransfer.registration.field_metric import Metric
from grasptransfer.registration.fit_residuals import GaussianPosePrior
from grasptransfer.registration.latent_fit import LatentFit, LatentFitStatus, Matching, latent_fit
from grasptransfer.registration.posterior import LatentPosterior, SpaceScore
from grasptransfer.registration.shape_space import EmSettings, ShapeSpace

__all__ = [
    "CpdProgress",
    "CpdResult",
    "CpdStatus",
    "DeformationField",
    "DisplacementModel",
    "EmSettings",
    "FieldPair",
    "GaussianPosePrior",
    "LatentFit",
    "LatentFitStatus",
    "LatentPosterior",
    "Matching",
    "Metric",
    "PreparedSource",
    "ShapeSpace",
    "SpaceScore",
    "cpd",
    "cpd_all",
    "latent_fit",
    "motion_along",
    "register_pair",
]
