"""Uncertainty of the lens that the lines determine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.straightening.fit import Fit, Problem, shared_error


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Covariances of ``a1, a2, ..., cx, cy``.

    Parameters
    ----------
    covariance : ndarray, shape (C + 2, C + 2)
        From the lines and the weak priors.
    centre_std : ndarray, shape (2,)
        Standard deviations of the centre from the lines alone, pixels; infinite where they give no
        information.
    """

    covariance: FloatArray
    centre_std: FloatArray


def uncertainty(problem: Problem, fit: Fit) -> Uncertainty:
    """Scale the inverse information by the spread of the residuals.

    The points of a line have common errors (blur, shadow, a bent edge): the spread is that of the
    gradients of whole lines, one factor for all, corrected for what the parameters absorb.
    """
    straightness, bundle = fit.straightness, fit.straightness.bundle
    jacobian = straightness.jacobian()
    weighted = (bundle.weights * bundle.per_point(fit.weights))[:, None] * jacobian
    line_information = bundle.sums(weighted[:, :, None] * jacobian[:, None, :])
    information = line_information.sum(axis=0)
    gradients = bundle.sums(weighted * straightness.residuals[:, None])
    # In units of the priors' standard deviations, which make the parameters comparable.
    unit = problem.prior_std()
    information = information * unit[:, None] * unit
    count = len(unit)
    ridge = (1e-12 * np.trace(information) / count + np.finfo(float).tiny) * np.eye(count)
    inverse = np.linalg.pinv(information + ridge, hermitian=True)
    scaled = gradients * unit
    leverages = np.einsum("ij,lji->l", inverse, line_information * unit[:, None] * unit)
    spread = float(np.einsum("li,ij,lj->", scaled, inverse, scaled)) / count
    effective = leverages.sum() ** 2 / max(float((leverages**2).sum()), 1e-300)
    spread *= effective / max(effective - count, 1.0)
    spread = max(spread, shared_error(problem, fit))
    covariance = np.linalg.inv(information / spread + np.eye(count))
    # The fit weights the priors more than this does: the shift that they caused is an error as
    # well.
    priors = problem.prior() * unit[:, None] * unit
    prior_shift = np.linalg.solve(
        information + priors, priors @ (problem.deviation(fit.lens) / unit)
    )
    covariance = (covariance + np.outer(prior_shift, prior_shift)) * unit[:, None] * unit
    centre_variances = np.diag(inverse)[-2:] * spread
    return Uncertainty(0.5 * (covariance + covariance.T), unit[-2:] * np.sqrt(centre_variances))
