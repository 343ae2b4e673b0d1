"""The lens under which most of a picture's long arcs are straight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trisquare._support.arrays import FloatArray
from trisquare.straightening.bundle import Bundle, CentredLens, Straightness
from trisquare.straightening.merging import joined, merged
from trisquare.straightening.radial import RadialLens

SEARCHED_COEFFICIENTS = np.linspace(0.4, -1.9, 70)
"""First coefficients of the search: from a pincushion lens to a circular fisheye."""

SEARCH_SCALE = 0.8
ROUND_SCALES = (0.8, 0.4, 0.2, 0.1, 0.05, 0.05)
"""RMS residuals at which a line's weight is one half, working pixels: in the search, and in each
round of merging and fitting. The last is below that of most real lines, which are then weighted by
the inverse of their mean square: a few straight walls more than all the grain of a floor."""

MAX_POINTS = 40
"""Maximum number of points as which a line counts."""

HELD_STD = 1e-6
"""Standard deviation of the prior of a parameter that is held."""
PRIORS = (5.0, 0.06, HELD_STD, 0.08, 0.08)
"""Standard deviations of the weak priors of ``a1, a2, a3, cx, cy`` about zero and the picture's
middle, in half diagonals. The third coefficient is held."""
FREE_PRIORS = (5.0, 0.3, 0.1, 0.08, 0.08)
"""The same with the third coefficient free: of such a lens the second is less known in advance."""
CENTRE = (3, 4)
"""Indices of the centre's coordinates among them."""
INITIAL_PRIOR_SPREAD = 1.0
"""Residual with the weight of a prior's standard deviation, working pixels, in the first fit."""
SHARED_ERRORS = 40.0
"""The same over a point's error, in later fits: the 40 points of a line have common errors, and so
do the lines of a plane that is not flat, as if some 40 of them were one."""
MIN_RMS = 0.02
"""Minimum error of a point, working pixels: lines may be straighter by chance."""

SHARED_POINTS = 12.0
"""Minimum number of points with a common error, of the rms of all: lines of one plane bend alike,
which the scatter between lines does not show."""
MIN_COST_GAIN = 4.0
"""Cost, in units of `shared_error`, by which the division model has to be better than the
polynomial: if the lines hardly distinguish them, chance would decide, and most lenses are described
by the polynomial."""

MAX_STEPS = 30
LAST_DECREASE = 1e-7
"""Relative decrease of the cost at which a fit ends."""
MAX_DAMPING = 1e8


@dataclass(frozen=True, slots=True)
class Fit:
    """A lens and the lines that it makes straight.

    Parameters
    ----------
    lens : CentredLens
    groups : list of list of int
        Indices of the curves of each line.
    straightness : Straightness
        Straightness of the lines.
    weights : ndarray, shape (L,)
        Weights of the lines in the last round: 1 for a straight one.
    """

    lens: CentredLens
    groups: list[list[int]]
    straightness: Straightness
    weights: FloatArray

    def lines(self) -> list[FloatArray]:
        """Return the points of each line in their order along it, pixels."""
        bundle, rows = self.straightness.bundle, self.straightness.rows
        normals = bundle.per_point(self.straightness.lines[:, :2])
        divisor = np.maximum(rows[:, 2], 1e-3)
        along = (normals[:, 0] * rows[:, 1] - normals[:, 1] * rows[:, 0]) / divisor
        line = bundle.per_point(np.arange(len(bundle.starts)))
        ordered = bundle.points[np.lexsort((along, line))]
        return np.split(ordered, bundle.starts[1:])


def fit_lens(problem: Problem) -> Fit:
    """Fit both families of lenses: search, then alternate robust least squares and merging."""
    first = alternate(problem, search(problem), ROUND_SCALES)
    problem = with_shared_errors(problem, first)
    division = alternate(problem, first.lens, ROUND_SCALES[-2:])
    polynomial = alternate(problem, as_polynomial(division.lens), ROUND_SCALES[-3:])
    # Both families are compared on the lines of both: one that merges less has less to explain.
    bundles = [fit.straightness.bundle for fit in (division, polynomial)]
    scale = ROUND_SCALES[-1] * problem.pixel

    def cost(fit: Fit) -> float:
        lenses = [refine(problem, bundle, fit.lens, scale) for bundle in bundles]
        pairs = zip(lenses, bundles, strict=True)
        costs = [lines_cost(bundle.measure(lens), scale) for lens, bundle in pairs]
        return sum(costs) / len(costs)

    cost_gain = cost(polynomial) - cost(division)
    return division if cost_gain > MIN_COST_GAIN * shared_error(problem, first) else polynomial


def shared_error(problem: Problem, fit: Fit) -> float:
    """Return the minimum squared error, px^2, of points with a common error."""
    return SHARED_POINTS * _point_error(problem, fit) ** 2


def with_shared_errors(problem: Problem, fit: Fit) -> Problem:
    """Weight the priors by the straightness of a fit's lines."""
    spread = SHARED_ERRORS * _point_error(problem, fit) / problem.pixel
    return replace(problem, prior_spread=spread)


def _point_error(problem: Problem, fit: Fit) -> float:
    """Return the standard error of a point, pixels, on a line of weight 1."""
    straightness, weights = fit.straightness, fit.weights
    counts = straightness.bundle.sums(straightness.bundle.weights)
    squares = counts @ (weights * straightness.rms) ** 2
    error = float(np.sqrt(squares / max(float(counts @ weights), 1e-12)))
    return max(error, MIN_RMS * problem.pixel)


def refit_third_coefficient(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """Fit the same family again with three coefficients; return the problem as well."""
    problem = replace(with_shared_errors(problem, fit), priors=FREE_PRIORS)
    return problem, alternate(problem, fit.lens, ROUND_SCALES[-3:])


def refit_held_centre(problem: Problem, fit: Fit) -> Fit:
    """Fit the same family again with the centre in the picture's middle."""
    priors = (*problem.priors[: CENTRE[0]], HELD_STD, HELD_STD)
    held_problem = replace(with_shared_errors(problem, fit), priors=priors)
    lens = CentredLens(fit.lens.radial, problem.middle)
    return alternate(held_problem, lens, ROUND_SCALES[-3:])


@dataclass(frozen=True, slots=True)
class Problem:
    """The data: arcs, the picture's middle and half diagonal, the size of a working pixel.

    A residual of `prior_spread` working pixels has the weight of the priors' standard deviations.
    """

    curves: tuple[FloatArray, ...]
    middle: FloatArray
    radius: float
    pixel: float
    priors: tuple[float, ...] = PRIORS
    prior_spread: float = INITIAL_PRIOR_SPREAD

    def bundle(self, groups: Sequence[Sequence[int]]) -> Bundle:
        """Return the bundle of the lines that groups of curves make."""
        return Bundle.of(joined(self.curves, groups), self.radius, MAX_POINTS)

    def prior(self) -> FloatArray:
        """Return the information of the weak priors, in the unit of the squared residuals."""
        return np.diag((self.prior_spread * self.pixel / self.prior_std()) ** 2)

    def prior_std(self) -> FloatArray:
        """Return the standard deviations of the priors, those of the centre in pixels."""
        std = np.array(self.priors)
        std[list(CENTRE)] *= self.radius
        return std

    def deviation(self, lens: CentredLens) -> FloatArray:
        """Return the parameters less the priors' means."""
        return np.asarray(lens.parameters - np.array([0.0, 0.0, 0.0, *self.middle]))

    def cost(self, lens: CentredLens, straightness: Straightness, scale: float) -> float:
        """Return the cost of the lines and of the priors."""
        deviation = self.deviation(lens)
        return lines_cost(straightness, scale) + float(deviation @ self.prior() @ deviation)


def alternate(problem: Problem, lens: CentredLens, scales: Sequence[float]) -> Fit:
    """Merge arcs that are one line under the lens, and fit the lens to the lines, alternately."""
    single = problem.bundle([[i] for i in range(len(problem.curves))])
    for scale in scales:
        groups = merged(problem.curves, single.measure(lens), lens, problem.pixel)
        bundle = problem.bundle(groups)
        lens = refine(problem, bundle, lens, scale * problem.pixel)
    straightness = bundle.measure(lens)
    weights = line_weights(straightness, scales[-1] * problem.pixel)
    return Fit(lens, groups, straightness, weights)


def as_polynomial(lens: CentredLens) -> CentredLens:
    """Return the polynomial that is nearest to a division lens over the picture."""
    radii = np.linspace(0.0, min(1.0, 0.9 * lens.radial.largest_radius()), 50)[1:]
    ideal = lens.radial.ideal_radius(radii)
    design = np.column_stack([ideal**3, ideal**5])
    solution, *_ = np.linalg.lstsq(design / radii[:, None], (radii - ideal) / radii, rcond=None)
    return CentredLens(RadialLens("polynomial", np.append(solution, 0.0)), lens.centre)


def search(problem: Problem) -> CentredLens:
    """Return the best lens of the search, by the squared lengths of the curves that are straight.

    The deviation of a curve from a straight line grows with its length squared, and so does its
    information.
    """
    bundle = problem.bundle([[i] for i in range(len(problem.curves))])
    lengths = np.array([np.linalg.norm(curve[-1] - curve[0]) for curve in problem.curves])
    scale = SEARCH_SCALE * problem.pixel

    def score(lens: CentredLens) -> float:
        return float(lengths**2 @ line_weights(bundle.measure(lens), scale))

    candidates = [np.array([first, 0.0, 0.0]) for first in SEARCHED_COEFFICIENTS]
    lenses = [
        CentredLens(RadialLens("division", coefficients), problem.middle)
        for coefficients in candidates
    ]
    return max(lenses, key=score)


def lines_cost(straightness: Straightness, scale: float) -> float:
    """Return Cauchy's cost of the lines' rms."""
    counts = straightness.bundle.sums(straightness.bundle.weights)
    return float(scale**2 * (counts @ np.log1p((straightness.rms / scale) ** 2)))


def line_weights(straightness: Straightness, scale: float) -> FloatArray:
    """Return each line's weight in Cauchy's cost, ``1 / (1 + (rms / scale)^2)``."""
    return np.asarray(1 / (1 + (straightness.rms / scale) ** 2))


def refine(problem: Problem, bundle: Bundle, lens: CentredLens, scale: float) -> CentredLens:
    """Minimise the cost by damped Gauss-Newton steps; it never rises."""
    prior = problem.prior()
    straightness = bundle.measure(lens)
    cost, damping = problem.cost(lens, straightness, scale), 1e-3
    for _ in range(MAX_STEPS):
        information, gradient = normal_equations(straightness, scale)
        information = information + prior
        gradient = gradient + prior @ problem.deviation(lens)
        while damping < MAX_DAMPING:
            damped = information + damping * np.diag(np.diag(information))
            step = np.asarray(-np.linalg.solve(damped, gradient), dtype=np.float64)
            trial_lens = lens.moved(step)
            trial_straightness = bundle.measure(trial_lens)
            trial_cost = problem.cost(trial_lens, trial_straightness, scale)
            if trial_cost <= cost:
                break
            damping *= 10
        else:
            return lens
        decrease = cost - trial_cost
        lens, straightness, cost = trial_lens, trial_straightness, trial_cost
        damping = max(damping / 10, 1e-9)
        if decrease <= LAST_DECREASE * cost:
            break
    return lens


def normal_equations(straightness: Straightness, scale: float) -> tuple[FloatArray, FloatArray]:
    """Return information and gradient of the weighted squares, by ``a1, a2, a3, cx, cy``."""
    bundle = straightness.bundle
    weights = bundle.weights * bundle.per_point(line_weights(straightness, scale))
    jacobian = straightness.jacobian()
    weighted = weights[:, None] * jacobian
    return weighted.T @ jacobian, weighted.T @ straightness.residuals
